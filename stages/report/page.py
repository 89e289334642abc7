"""A page of the report, drawn from the tables alone: figures as files, and one HTML file. What it
shows is in ``items.yaml``.
"""

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cache, partial
from itertools import groupby
from pathlib import Path
from typing import Annotated, Any

import pandas as pd
from jinja2 import Environment, PackageLoader, StrictUndefined, select_autoescape
from jinja2.utils import htmlsafe_json_dumps
from markdown_it import MarkdownIt
from markupsafe import Markup
from pydantic import Field

from isi import config
from isi.config import Section, check_names
from isi.errors import at
from isi.tables.io import atomically, opening
from stages.pipeline import missing
from stages.report import charts, figures
from stages.report.explorer import TEMPLATES, script
from stages.report.scopes import TITLES
from stages.report.tables import forms
from stages.report.tables.registry import check_name, write_files

#: Questions about an entity, by relation of which it is the head.
QUESTIONS = {
    "atLocation": "Where is it found?",
    "hasAffordance": "What can one do with it?",
    "hasMaterial": "What is it made of?",
}
#: Headers on the page, by header in files.
HEADERS = {**TITLES, "ours": "the paper's graph"}
#: Entries of the bar on top of all pages: title and place below ``reports``.
BAR = {
    "Start": "index.html",
    "Try": "index.html#try",
    "Results": "index.html#results",
    "The paper": "index.html#paper",
    "Further": "beyond/index.html",
    "Method": "index.html#method",
    "Library": "../README.md",
}
_ITEMS = Path(__file__).with_name("items.yaml")
_MARKDOWN = MarkdownIt("zero").enable(["list", "link", "backticks", "emphasis"])


# What pages show (items.yaml)


class ReportItem(Section):
    """A table or, with ``draw``, a figure of a page."""

    name: str  #: of its files, and of the CSV from which it is made
    title: str
    caption: str = ""
    part: str = ""  #: of the page; empty: files alone
    draw: str = ""  #: the function of ``figures`` that draws it
    table: str = ""  #: of a figure: the CSV from which it is drawn, if of another name
    #: shown on the page; empty: all
    columns: Annotated[list[str], Field(default_factory=list)]
    #: shown on the page, by column: rows with one of these values; if there are none, all
    rows: Annotated[dict[str, list[str]], Field(default_factory=dict)]
    #: whose numbers of seeds its caption has: keys of the table ``run`` without ``.seeds``
    seeds: Annotated[list[str], Field(default_factory=list)]
    closed: bool = False  #: whether it is folded at first
    panels: int = 0  #: number of panels that the page shows; 0: all

    @property
    def source(self) -> str:
        """The name of its CSV."""
        return self.table or self.name


class Part(Section):
    """A part of a page."""

    id: str
    title: str
    closed: bool = False


class Page(Section):
    """A page: its folder below ``reports``, its title, parts and items."""

    folder: str
    title: str
    lead: str
    parts: list[Part]
    items: list[ReportItem]
    foot: list[str]


@cache
def pages() -> dict[str, Page]:
    """All pages by name; ``InputError`` names the item whose part or figure does not exist."""
    by_name = config.check(config.read(_ITEMS), dict[str, Page], "", _ITEMS)
    with at(_ITEMS):
        for name, page in by_name.items():
            parts = ["", *(part.id for part in page.parts)]
            for item in page.items:
                key = f"{name}.items.{item.name}"
                check_names([item.part], parts, f"{key}.part")
                check_names([item.draw], ["", *_drawings()], f"{key}.draw")
    return by_name


def _drawings() -> list[str]:
    """The names of the functions of ``figures``."""
    functions = vars(figures).items()
    return [
        name
        for name, function in functions
        if getattr(function, "__module__", "") == figures.__name__
    ]


# What a page shows of a table


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

    def values(self, name: str, column: str, /, **where: Any) -> list[Any]:
        """The values of a column in the rows with these values (a list: with one of them); none
        without the table.
        """
        frame = self.get(name)
        if frame is None or column not in frame:
            return []
        for key, value in where.items():
            options = [str(each) for each in (value if isinstance(value, list) else [value])]
            frame = frame[frame[key.replace("_", " ")].astype(str).isin(options)]
        return list(frame[column].dropna())

    def number(self, name: str, column: str, first: str = "", /, **where: Any) -> Markup:
        """A value with one decimal from the row with these values, as text; "–" without one.
        ``first``: the value of its first column.
        """
        frame = self.get(name)
        if first and frame is not None:
            where |= {frame.columns[0]: first}
        value = next(iter(self.values(name, column, **where)), None)
        return Markup("{}").format("–" if value is None else _written(value))

    def span(self, name: str, *columns: str, **where: Any) -> Markup:
        """The least and the greatest of the values in some columns, as text; "–" without any."""
        values = [value for column in columns for value in self.values(name, column, **where)]
        values = values or ["–"]
        return Markup(" to ").join(dict.fromkeys(map(_written, (min(values), max(values)))))

    def quoted(self, name: str, column: str, /, **where: Any) -> Markup:
        """The texts of a column in the rows with these values, in quotation marks."""
        return Markup(", ").join(f"“{text}”" for text in self.values(name, column, **where))

    def count(self, name: str, column: str, /, **where: Any) -> int:
        """The number of rows with these values."""
        return len(self.values(name, column, **where))

    def made(self, item: ReportItem | None = None) -> str:
        """Of which run the tables are: the commit of its code and its date, as far as they are
        known; before them the numbers of seeds of an item.
        """
        frame = self.get("run")
        values = {} if frame is None else dict(zip(frame["name"], frame["value"], strict=True))
        numbers = {
            str(value)
            for seeds in (item.seeds if item else [])
            for name, value in values.items()
            if name.endswith(f"{seeds}.seeds") and str(value).isdigit()
        }
        *most, last = sorted(numbers, key=int) or [""]
        parts = [f"{', '.join(most)}{' or ' if most else ''}{last} seeds"] if last else []
        if "commit" in values:
            parts.append(f"run of commit {values['commit']} ({values['date']})")
        return "; ".join(parts)


def _written(value: Any) -> str:
    """A number with one decimal, or without if it is whole; a text as it is."""
    if isinstance(value, str):
        return value
    return f"{value:,.0f}" if float(value).is_integer() else f"{value:.1f}"


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
        """The files of a figure, by name; none of a table."""
        by_form = charts.files(self.panels) if self.panels else {}
        return {f"{self.item.name}.{form}": content for form, content in by_form.items()}


def write(name: str, reports: Path, demonstration: Path | None = None) -> Path:
    """Write a page and its figures from its tables below ``reports``, each file atomically.

    ``demonstration``: what the picture and the explorer show. Items without data are left out; an
    ``InputError`` names an item whose table no function gives.
    """
    page = pages()[name]
    folder = reports / page.folder
    if not (folder / "tables").is_dir():
        raise missing(folder / "tables")
    tables = PageTables(folder / "tables")
    items, drawings = list[Rendered](), dict[str, bytes]()
    for item in page.items:
        frame = tables.get(item.source)
        if frame is None:
            with at(_ITEMS):
                check_name(name, item.source, f"{name}.items.{item.name}")
        elif len(frame):
            items.append(rendered(item, frame))
            drawings |= items[-1].files()
    # DVC wants the folder where no table has a figure, too
    (folder / "figures").mkdir(parents=True, exist_ok=True)
    write_files(folder / "figures", drawings)
    shown = json.loads(demonstration.read_text("utf-8")) if demonstration else {}
    text = html(name, page, items, tables, shown)
    place = folder / "index.html"
    atomically(place, partial(Path.write_bytes, data=text.encode()))
    return place


def rendered(item: ReportItem, frame: pd.DataFrame) -> Rendered:
    """An item with the data of its table."""
    if item.draw:
        return Rendered(item, panels=tuple(getattr(figures, item.draw)(frame)))
    for column, values in item.rows.items():
        chosen = frame[frame[column].astype(str).isin(values)]
        frame = chosen if len(chosen) else frame
    return Rendered(item, shown_table(frame, item.columns))


def shown_table(frame: pd.DataFrame, only: Any = ()) -> ShownTable:
    """A table as the page shows it: of ``only`` these columns, if there are any."""
    columns, texts = list[Column](), forms.with_intervals(frame)
    for name, cells in texts.items():
        if only and name not in only:
            continue
        header = "" if name.startswith("Unnamed: ") else name  # pandas' for an empty one
        group, _, title = header.rpartition(": ")
        if any(other.startswith(f"{name}: ") for other in texts):
            group, title = name, "here"
        is_text = not forms.is_number(frame[name]) and not frame[name].isna().all()
        headers = (HEADERS.get(group, group), HEADERS.get(title, title))
        columns.append(Column(*headers, is_text, cells))
    return ShownTable(columns)


def _environment() -> Environment:
    """The templates of pages."""
    environment = Environment(
        loader=PackageLoader("stages.report"),
        autoescape=select_autoescape(),
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters["json"] = _json
    return environment


def html(
    name: str, page: Page, items: list[Rendered], tables: PageTables, shown: Mapping[str, Any]
) -> str:
    """The HTML of a page."""
    environment = _environment()

    functions = {each: getattr(tables, each) for each in ("number", "span", "quoted", "count")}

    def filled(text: str) -> str:
        return environment.from_string(text).render(functions)

    def prose(part: str) -> Markup:
        path = TEMPLATES / "prose" / name / f"{part}.md"
        text = path.read_text("utf-8") if path.exists() else ""
        return Markup(_MARKDOWN.render(filled(text)))  # noqa: S704

    def line(text: str) -> Markup:
        return Markup(_MARKDOWN.renderInline(filled(text)))  # noqa: S704

    up = "../" if page.folder else ""
    here = f"{page.folder}/index.html" if page.folder else "index.html"
    bar = {title: f"{up}{place}" for title, place in BAR.items()}
    picture = shown.get("picture")
    explorer = shown.get("explorer")
    shown_parts = {rendered.item.part for rendered in items} | ({"try"} if explorer else set())
    return environment.get_template("page.html").render(
        page=page,
        bar=bar,
        here=f"{up}{here}",
        parts=[part for part in page.parts if part.id in shown_parts or prose(part.id)],
        items=items,
        picture=picture,
        explorer=explorer,
        explorer_script=script() if explorer else "",
        prose=prose,
        line=line,
        made=tables.made,
        number=tables.number,
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
