"""The page: one self-contained HTML file, and every table and figure as files beside it."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from importlib import resources
from itertools import groupby
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
import pandas as pd
from jinja2 import Environment, PackageLoader, StrictUndefined, select_autoescape
from markupsafe import Markup, escape

from isi.report import steady, summary, wording
from isi.report.drawing import Drawing, colours, drawing, palette
from isi.report.figures import STYLE, boxes, in_words, rendered
from isi.report.glossary import Marker, terms
from isi.report.metrics import metrics, plots
from isi.report.results import Results
from isi.report.section import Content, Figure, Heading, Section, Table, Words
from isi.report.statistics import HIGH, LOW
from isi.report.summary import Verdict
from isi.tables.io import atomically

#: Sections that have something to say, each with what it says.
Made = Sequence[tuple[Section, Sequence[Content]]]
#: A number in a sentence that there is none of.
_ABSENT = re.compile(r"(?<![\w.-])[+\-−±]?(?:nan|inf)\b")


def write(folder: Path, results: Results, sections: Sequence[Section]) -> None:
    """Write the page and everything beside it, each file whole or not at all; files of an earlier report go."""
    with mpl.rc_context(STYLE):
        every = [(section, list(section.contents(results))) for section in sections]
        verdict = summary.verdict(results)
    made = [(section, contents) for section, contents in every if contents]
    files: dict[Path, bytes] = {}
    drawings: dict[str, Drawing] = {}
    shown = [content for _, contents in made for content in contents]
    for content in [*shown, *([verdict.figure] if verdict.figure else [])]:
        if isinstance(content, Table):
            files |= {
                folder / "tables" / f"{content.name}.{form}": text.encode() for form, text in forms(content).items()
            }
        elif isinstance(content, Figure):
            words = in_words(content.canvas)
            steady.steady(content.canvas)
            drawn = {form: rendered(content.canvas, form) for form in ("png", "svg")}
            files |= {folder / "figures" / f"{content.name}.{form}": drawing for form, drawing in drawn.items()}
            boxed, across = boxes(content.canvas)
            drawings[content.name] = drawing(drawn["svg"].decode(), f"f{len(drawings)}", boxed, across, words)
    for name, frame in plots(results).items():
        files[folder / "plots" / f"{name}.csv"] = steady.csv(frame).encode()
    files[folder / "metrics.json"] = (json.dumps(metrics(results), indent=2) + "\n").encode()
    files[folder / "index.html"] = html(made, drawings, verdict, results).encode()
    for path, data in files.items():
        atomically(path, lambda temporary, data=data: temporary.write_bytes(data))  # type: ignore[misc]
    for part in ("tables", "figures", "plots"):
        for path in set((folder / part).glob("*")) - set(files):
            path.unlink()


def html(made: Made, drawings: Mapping[str, Drawing], verdict: Verdict, results: Results) -> str:
    """The page itself; ``drawings``: of figures, by name."""
    environment = Environment(
        loader=PackageLoader("isi.report"), autoescape=select_autoescape(), undefined=StrictUndefined, trim_blocks=True,
        lstrip_blocks=True,
    )  # fmt: skip
    titles = {one.name: one.title for one in results.experiments.values()}
    known = terms(results)
    ids = {section.id for section, _ in made}
    ids |= {term.id for _, contents in made for one in contents if isinstance(one, Words) for term in one.terms}
    marker = Marker([term for term in known if term.id in ids])
    panels = [str(panel) for one in drawings.values() for panel in [*one.panels, *(sign for sign, _ in one.legend)]]
    return environment.get_template("page.html").render(
        title=summary.TITLE,
        question=summary.QUESTION,
        verdict=verdict,
        colours=palette(colours(panels)),
        style=_inlined("style.css"),
        script=_inlined("page.js"),
        groups=[(name, list(own)) for name, own in groupby(made, key=lambda one: one[0].group)],
        parts=parts,
        form=lambda content: type(content).__name__,
        marked_up=lambda text: Markup(marker.text(marked_up(text, ids))),  # noqa: S704
        plain=lambda text: marked_up(text, ids),
        marker=marker,
        drawings=drawings,
        shown=lambda table: Shown.of(table, titles),
    )


def _inlined(name: str) -> Markup:
    """A file beside the templates, as it stands."""
    return Markup(resources.files("isi.report").joinpath("templates", name).read_text("utf-8"))  # noqa: S704


def parts(contents: Sequence[Content]) -> list[tuple[Heading | None, list[Content]]]:
    """A section's contents under their headings; first what stands under none."""
    found: list[tuple[Heading | None, list[Content]]] = [(None, [])]
    for content in contents:
        if isinstance(content, Heading):
            found.append((content, []))
        else:
            found[-1][1].append(content)
    return [(heading, own) for heading, own in found if heading or own]


def marked_up(text: str, ids: Collection[str]) -> Markup:
    """Text with ```code```, ``**weight**`` and ``[links](#section)`` as elements; links lead to what is there."""

    def link(place: re.Match[str]) -> str:
        there = not place[2].startswith("#") or place[2][1:] in ids
        return f'<a href="{place[2]}">{place[1]}</a>' if there else place[1]

    text = _ABSENT.sub("–", text)
    linked = re.sub(r"\[([^\]]+)\]\((#[\w-]+|https://[^)\s]+)\)", link, str(escape(text)))
    weighed = re.sub(r"\*\*(.+?)\*\*", r"<strong>\1</strong>", linked)
    return Markup(re.sub(r"`([^`]+)`", r"<code>\1</code>", weighed))  # noqa: S704


@dataclass(frozen=True)
class Shown:
    """A table as the page shows it, in words that people read."""

    #: of columns: what neighbours share, and over how many of them; none where no column shares anything
    groups: list[tuple[str, int]]
    #: of columns: what each is, and whether it is of numbers
    headers: list[tuple[str, bool]]
    #: of rows: each cell's text, and the interval behind it
    rows: list[list[tuple[str, str]]]

    @classmethod
    def of(cls, table: Table, titles: Mapping[str, str]) -> Shown:
        """A table's frame; ``titles``: of experiments."""
        names = columns_of(table.frame)
        both = [wording.header(name, titles) for name in names]
        grouped = [(group, len(list(own))) for group, own in groupby(group for group, _ in both)]
        frame = shorten(table.frame, table.formats)
        rows = [
            [_split(wording.cell(name, text, titles)) for name, text in zip(names, row, strict=True)]
            for row in frame.itertuples(index=False, name=None)
        ]
        numeric = [side == "right" for side in _alignment(table)]
        headers = [(own, is_number) for (_, own), is_number in zip(both, numeric, strict=True)]
        return cls(grouped if any(group for group, _ in grouped) else [], headers, rows)


def _split(text: str) -> tuple[str, str]:
    """A value and its interval; a text that is not of both stays whole."""
    found = re.fullmatch(r"(\S+) (\[\S+ \S+\].*)", text)
    return (found[1], found[2]) if found else (text, "")


def forms(table: Table) -> dict[str, str]:
    """A table as CSV, Markdown and LaTeX."""
    shown = shorten(table.frame, table.formats)
    return {
        "csv": steady.csv(table.frame, table.of_any_size),
        "md": shown.to_markdown(index=False, disable_numparse=True, colalign=_alignment(table)) + "\n",
        "tex": _latex(table, shown),
    }


def shorten(frame: pd.DataFrame, formats: Mapping[str, Callable[[Any], str]] | None = None) -> pd.DataFrame:
    """Numbers as people read them: one decimal, none for whole columns, a dash for what is not there.

    Where the ends of a column's interval stand in columns of their own, they stand behind it in brackets.
    """
    formats, shown = formats or {}, {}
    for name in columns_of(frame):
        ends = [name + end for end in (LOW, HIGH) if name + end in frame]
        how = formats.get(name) or _plain(frame[[name, *ends]])
        parts = [[_shown(value, how) for value in frame[column]] for column in (name, *ends)]
        shown[name] = [_with_interval(*cells) for cells in zip(*parts, strict=True)]
    return pd.DataFrame(shown)


def columns_of(frame: pd.DataFrame) -> list[str]:
    """The columns that are shown as such: not those with ends of intervals."""
    ends = {name + end for name in frame.columns for end in (LOW, HIGH)}
    return [name for name in frame.columns if name not in ends]


def _plain(columns: pd.DataFrame) -> Callable[[Any], str]:
    parts = columns.apply(pd.to_numeric, errors="coerce").to_numpy(float).round(3) % 1
    digits = 0 if (np.isnan(parts) | (parts == 0)).all() else 1
    return lambda value: f"{round(value, digits) + 0.0:,.{digits}f}"  # no -0.0


def _shown(value: Any, how: Callable[[Any], str]) -> str:
    if value is None or (isinstance(value, float) and pd.isna(value)):
        return "–"
    return value if isinstance(value, str) else how(value)


def _with_interval(value: str, low: str = "–", high: str = "–") -> str:
    return value if "–" in (low, high) else f"{value} [{low}, {high}]"


def _alignment(table: Table) -> tuple[str, ...]:
    frame = table.frame
    texts = [
        name not in table.formats and frame[name].map(lambda value: isinstance(value, str)).any()
        for name in columns_of(frame)
    ]
    return tuple("left" if text else "right" for text in texts)


def _latex(table: Table, shown: pd.DataFrame) -> str:
    columns = "".join(side[0] for side in _alignment(table))
    text = shown.replace("–", "--").style.hide(axis="index").format(escape="latex").format_index(escape="latex", axis=1)
    latex: str = text.to_latex(hrules=True, column_format=columns)
    return latex.replace("ξ", r"$\xi$").replace("Θ", r"$\Theta$")
