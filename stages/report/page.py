"""A page of the report, drawn from the tables alone: figures as files, and one HTML file."""

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cache, partial
from itertools import groupby
from pathlib import Path
from typing import Any

import pandas as pd
from jinja2 import Environment, PackageLoader, StrictUndefined, select_autoescape
from jinja2.utils import htmlsafe_json_dumps
from markdown_it import MarkdownIt
from markupsafe import Markup

from isi.tables.io import atomically, opening
from stages.pipeline import missing
from stages.report import charts, figures
from stages.report.explorer import TEMPLATES, script
from stages.report.items import BAR, PAGES, Page, ReportItem
from stages.report.scopes import TITLES
from stages.report.tables import forms
from stages.report.tables.registry import write_files

#: Questions about an entity, by relation of which it is the head.
QUESTIONS = {
    "atLocation": "Where is it found?",
    "hasAffordance": "What can one do with it?",
    "hasMaterial": "What is it made of?",
}
#: Headers on the page, by header in files.
HEADERS = {**TITLES, "ours": "the paper's graph"}
_MARKDOWN = MarkdownIt("zero").enable(["list", "link", "backticks", "emphasis"])


@dataclass(frozen=True)
class Column:
    """A column as the page shows it: its headers, and for each cell a value and its interval."""

    group: str
    title: str
    is_text: bool
    cells: list[tuple[str, str]]


@dataclass(frozen=True, eq=False)
class ShownTable:
    """A table as the page shows it."""

    columns: list[Column]

    @property
    def rows(self) -> list[list[tuple[Column, tuple[str, str]]]]:
        """For each row, its columns with their cells."""
        cells = zip(*(column.cells for column in self.columns), strict=True)
        return [list(zip(self.columns, row, strict=True)) for row in cells]

    @property
    def groups(self) -> list[tuple[str, int]]:
        """Title and number of columns of each group of neighbours; empty without groups."""
        neighbours = groupby(column.group for column in self.columns)
        groups = [(group, len(list(columns))) for group, columns in neighbours]
        return groups if any(name for name, _ in groups) else []

    @property
    def has_texts(self) -> bool:
        """Whether it has several columns of text: then it is a list of cards on a phone."""
        return sum(column.is_text for column in self.columns) > 1


@dataclass(frozen=True, eq=False)
class PageTables:
    """The tables in a folder, by name."""

    folder: Path

    @cache  # noqa: B019  # as long as the page
    def get(self, name: str) -> pd.DataFrame | None:
        """A table; None where there is none."""
        path = self.folder / f"{name}.csv"
        if not path.exists():
            return None
        with opening(path, "a table of the report", ValueError):
            return pd.read_csv(path)

    def number(self, name: str, column: str, /, **where: Any) -> Markup:
        """A value with one decimal from the row with these values, as text; "–" without one."""
        frame = self.get(name)
        if frame is not None:
            for key, value in where.items():
                frame = frame[frame[key.replace("_", " ")].astype(str) == str(value)]
        value = None if frame is None or column not in frame else next(iter(frame[column]), None)
        if value is None or pd.isna(value):
            return Markup("–")
        if not isinstance(value, str):
            value = f"{value:,.0f}" if float(value).is_integer() else f"{value:.1f}"
        return Markup("{}").format(value)


@dataclass(frozen=True, eq=False)
class Rendered:
    """An item that has data: its table, or its panels."""

    item: ReportItem
    table: ShownTable | None = None
    panels: tuple[charts.Panel, ...] = ()

    @property
    def id(self) -> str:
        return f"{'figure' if self.item.draw else 'table'}-{self.item.name}"

    def shown(self) -> Iterator[tuple[Markup, dict[str, Any], str]]:
        """For each panel that the page shows: its element, its values, and its title."""
        number = self.item.panels or len(self.panels)
        for place, panel in enumerate(self.panels[:number]):
            text, values = charts.alone(panel, f"{self.item.name}{place}")
            yield Markup(text), values, panel.title  # noqa: S704

    def files(self) -> Mapping[str, bytes]:
        """The files of a figure, by name."""
        made = charts.files(self.panels).items()
        return {f"{self.item.name}.{form}": content for form, content in made}


def write(name: str, reports: Path, demonstration: Path | None = None) -> Path:
    """Write a page and its figures from its tables below ``reports``, each file atomically.

    ``demonstration``: what the picture and the explorer show. Items without data are left out.
    """
    page = PAGES[name]
    folder = reports / page.folder
    if not (folder / "tables").is_dir():
        raise missing(folder / "tables")
    tables = PageTables(folder / "tables")
    items = [made for item in page.items if (made := rendered(item, tables))]
    drawings = dict[str, bytes]()
    for made in items:
        drawings |= made.files() if made.panels else {}
    # DVC wants the folder where no table has a figure, too
    (folder / "figures").mkdir(parents=True, exist_ok=True)
    write_files(folder / "figures", drawings)
    shown = json.loads(demonstration.read_text("utf-8")) if demonstration else {}
    text = html(name, page, items, tables, shown)
    place = folder / "index.html"
    atomically(place, partial(Path.write_bytes, data=text.encode()))
    return place


def rendered(item: ReportItem, tables: PageTables) -> Rendered | None:
    """An item with its data; None where there are none."""
    frame = tables.get(item.source)
    if frame is None or not len(frame):
        return None
    if item.draw:
        return Rendered(item, panels=tuple(getattr(figures, item.draw)(frame)))
    return Rendered(item, shown_table(frame, item.columns))


def shown_table(frame: pd.DataFrame, only: Any = ()) -> ShownTable:
    """A table as the page shows it: of ``only`` these columns, if there are any."""
    columns, texts = list[Column](), forms.with_intervals(frame)
    for name, cells in texts.items():
        if only and name not in only:
            continue
        given = "" if name.startswith("Unnamed: ") else name  # pandas' for an empty one
        group, _, title = given.rpartition(": ")
        if any(other.startswith(f"{name}: ") for other in texts):
            group, title = name, "here"
        is_text = not forms.is_number(frame[name]) and not frame[name].isna().all()
        headers = (HEADERS.get(group, group), HEADERS.get(title, title))
        columns.append(Column(*headers, is_text, cells))
    return ShownTable(columns)


def html(
    name: str, page: Page, items: list[Rendered], tables: PageTables, shown: Mapping[str, Any]
) -> str:
    """The HTML of a page."""
    environment = Environment(
        loader=PackageLoader("stages.report"),
        autoescape=select_autoescape(),
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters["json"] = _json

    def prose(part: str) -> Markup:
        path = TEMPLATES / "prose" / name / f"{part}.md"
        if not path.exists():
            return Markup("")
        text = environment.from_string(path.read_text("utf-8")).render(number=tables.number)
        return Markup(_MARKDOWN.render(text))  # noqa: S704

    def line(text: str) -> Markup:
        filled = environment.from_string(text).render(number=tables.number)
        return Markup(_MARKDOWN.renderInline(filled))  # noqa: S704

    up = "../" if page.folder else ""
    here = f"{page.folder}/index.html" if page.folder else "index.html"
    bar = {title: f"{up}{place}" for title, place in BAR.items()}
    picture = shown.get("picture")
    explorer = shown.get("explorer")
    parts = [
        part
        for part in page.parts
        if (part.id == "try" and explorer) or any(made.item.part == part.id for made in items)
    ]
    return environment.get_template("page.html").render(
        page=page,
        bar=bar,
        here=f"{up}{here}",
        parts=parts,
        items=items,
        picture=picture,
        explorer=explorer,
        explorer_script=script() if explorer else "",
        prose=prose,
        line=line,
        question=lambda relation: QUESTIONS.get(relation, f"(it, {relation}, ?)"),
        terms=glossary() if not page.folder else [],
    )


def _json(data: Any) -> Markup:
    return htmlsafe_json_dumps(data, separators=(",", ":"))


def glossary() -> list[tuple[str, str]]:
    """The terms of ``glossary.txt`` with their meanings: each entry is a line with the term, then
    lines of its meaning.
    """
    text = (TEMPLATES / "glossary.txt").read_text("utf-8")
    entries = [entry.split("\n") for entry in text.strip().split("\n\n")]
    return [(heading.split(" | ")[0], " ".join(lines)) for heading, *lines in entries]
