"""The page, one self-contained HTML file, and every table and figure as files beside it."""

from __future__ import annotations

import json
import re
from collections.abc import Collection, Mapping, Sequence
from itertools import groupby
from pathlib import Path

import matplotlib as mpl
from jinja2 import Environment, PackageLoader, StrictUndefined, select_autoescape
from jinja2.utils import htmlsafe_json_dumps
from markupsafe import Markup, escape

from isi.report import svg
from isi.report.data import Results
from isi.report.figures import STYLE, in_words, rendered
from isi.report.glossary import Marker, terms
from isi.report.metrics import metrics, plots
from isi.report.section import Block, Part, Section, text_of
from isi.report.tables import Column, Table, csv
from isi.report.verdict import VERDICT
from isi.report.words import WORDS
from isi.tables.io import atomically

#: A null number in a sentence.
_ABSENT = re.compile(r"(?<![\w.-])[+\-−±]?(?:nan|inf)\b(?: \[[+-]?nan, [+-]?nan\])?")


def write(folder: Path, results: Results, sections: Sequence[Section]) -> None:
    """Write the page and everything beside it, each file whole or not at all; files of an earlier report go."""
    with mpl.rc_context(STYLE):
        verdict = VERDICT.part(results)
        parts = [part for section in sections if (part := section.part(results))]
    blocks = [block for part in [*parts, *([verdict] if verdict else [])] for block in part.blocks]
    files: dict[Path, bytes] = {}
    figures: dict[str, Markup] = {}
    for block in blocks:
        if block.kind == "table":
            name = block.content.name
            files |= {folder / "tables" / f"{name}.{form}": text.encode() for form, text in block.content.files.items()}
        elif block.kind == "figure":
            name, canvas = block.content.name, block.content.canvas
            drawn = {form: rendered(canvas, form) for form in ("png", "svg")}
            files |= {folder / "figures" / f"{name}.{form}": drawing for form, drawing in drawn.items()}
            figures[name] = svg.inline(drawn["svg"].decode(), f"f{len(figures)}")
    for name, frame in plots(results).items():
        files[folder / "plots" / f"{name}.csv"] = csv(frame).encode()
    files[folder / "metrics.json"] = (json.dumps(metrics(results), indent=2) + "\n").encode()
    files[folder / "index.html"] = html(parts, verdict, figures, results).encode()
    for path, data in files.items():
        atomically(path, lambda temporary, data=data: temporary.write_bytes(data))  # type: ignore[misc]
    for kind in ("tables", "figures", "plots"):
        for path in set((folder / kind).glob("*")) - set(files):
            path.unlink()


def html(parts: Sequence[Part], verdict: Part | None, figures: Mapping[str, Markup], results: Results) -> str:
    """The page itself; ``figures``: by name."""
    environment = Environment(
        loader=PackageLoader("isi.report"), autoescape=select_autoescape(), undefined=StrictUndefined, trim_blocks=True,
        lstrip_blocks=True,
    )  # fmt: skip
    ids = {part.id for part in parts}
    ids |= {term.id for part in parts for block in part.blocks if block.kind == "terms" for term in block.content}
    marker = Marker([term for term in terms(results) if term.id in ids])
    return environment.get_template("page.html").render(
        verdict=verdict,
        colours=svg.colours(figures.values()),
        style=Markup(text_of("style.css")),  # noqa: S704
        script=Markup(text_of("page.js")),  # noqa: S704
        groups=[(name, list(group)) for name, group in groupby(parts, key=lambda part: part.group)],
        headed=headed,
        marked_up=lambda text: Markup(marker.text(marked_up(text, ids))),  # noqa: S704
        marker=marker,
        figures=figures,
        in_words=in_words,
        header=header,
        column_groups=column_groups,
        json=lambda data: htmlsafe_json_dumps(data, separators=(",", ":")),
    )


def headed(blocks: Sequence[Block]) -> list[tuple[Block | None, list[Block]]]:
    """Blocks under their headings; first those under none."""
    found: list[tuple[Block | None, list[Block]]] = [(None, [])]
    for block in blocks:
        if block.kind == "heading":
            found.append((block, []))
        else:
            found[-1][1].append(block)
    return [(heading, under) for heading, under in found if heading or under]


def marked_up(text: str, ids: Collection[str]) -> Markup:
    """Text with ```code```, ``**weight**`` and ``[links](#section)`` as elements; links lead to what is there."""

    def link(place: re.Match[str]) -> str:
        there = not place[2].startswith("#") or place[2][1:] in ids
        return f'<a href="{place[2]}">{place[1]}</a>' if there else place[1]

    text = _ABSENT.sub("–", text)
    linked = re.sub(r"\[([^\]]+)\]\((#[\w-]+|https://[^)\s]+)\)", link, str(escape(text)))
    weighed = re.sub(r"\*\*(.+?)\*\*", r"<strong>\1</strong>", linked)
    return Markup(re.sub(r"`([^`]+)`", r"<code>\1</code>", weighed))  # noqa: S704


def header(column: Column) -> str:
    """What people read above a column, below that of its group."""
    return column.title or WORDS.get(column.name, column.name)


def column_groups(table: Table) -> list[tuple[str, int]]:
    """What neighbouring columns share, and how many of them do; none where no column shares anything."""
    groups = [(WORDS.get(name, name), len(list(columns))) for name, columns in groupby(c.group for c in table.columns)]
    return groups if any(name for name, _ in groups) else []
