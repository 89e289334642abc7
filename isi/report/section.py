"""A section of the page: a function gives its numbers, tables and figures, a template its sentences and captions.

A template is text in blocks with empty lines between them. A block is a paragraph, or starts with one of these::

    # TITLE [| open]                    the section's title; an open section is shown at first
    ## TITLE [| folded]                 opens a part of the section; a folded part is shown on a click
    - TEXT                              items of a list
    @table NAME | TITLE [| folded]      a table with the text below as its caption; likewise @figure
    @listing NAME | TITLE [| folded]    names and values; NAME is one of the section's numbers
    @terms NAME | TITLE [| folded]      words and their meanings
    @explorer NAME, @guide              parts of the page with templates of their own

In text, ```code```, ``**weight**``, ``[text](#section)`` and ``[text](https://…)`` are marked up; a link to a
section that the page does not have is plain text.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from importlib import resources
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined

from isi.report import words
from isi.report.data import Experiment, Results
from isi.report.figures import Figure
from isi.report.models import described, label
from isi.report.tables import Table
from isi.report.words import capitalized


@dataclass(frozen=True)
class Content:
    """What a section has to show: once, or once for each of several experiments."""

    #: for the template
    numbers: Mapping[str, Any] = field(default_factory=dict)
    #: the template names them without the suffix
    shown: Sequence[Table | Figure] = ()
    #: opens a part of the section; for the template
    heading: str = ""
    #: behind names of tables and figures, and the title of the experiment behind theirs
    suffix: str = ""
    title: str = ""


@dataclass(frozen=True)
class Block:
    """A part of a section as its template has it."""

    #: paragraph, list, heading, or the name behind ``@``
    kind: str
    text: str = ""
    items: Sequence[str] = ()
    title: str = ""
    folded: bool = False
    #: a table, a figure, or numbers
    content: Any = None


@dataclass(frozen=True)
class Part:
    """A section with something to show."""

    id: str
    title: str
    opened: bool
    blocks: Sequence[Block]
    group: str = ""


@dataclass(frozen=True)
class Section:
    """A function of ``isi/report/sections``, whose template has the same name."""

    name: str
    contents: Callable[[Results], Iterable[Content]]
    #: in place of the template
    text: str | None = None
    #: the part of the page that it belongs to
    group: str = ""

    def part(self, results: Results) -> Part | None:
        """The section as the page shows it; None where it has nothing to show."""
        title, flag, blocks = "", "", list[Block]()
        for number, content in enumerate(self.contents(results)):
            numbers = {**content.numbers, "heading": content.heading, "first": number == 0}
            for block in parsed(self.template.render(numbers), content):
                if block.kind == "section":
                    title, flag = block.title, block.text
                elif block.kind == "list" and blocks and blocks[-1].kind == "list":
                    blocks[-1] = replace(block, items=[*blocks[-1].items, *block.items])
                else:
                    blocks.append(block)
        return Part(self.name.replace("_", "-"), title, flag == "open", blocks, self.group) if blocks else None

    @property
    def template(self) -> Any:
        """Its template."""
        return _ENVIRONMENT.from_string(self.text) if self.text else _ENVIRONMENT.get_template(f"{self.name}.md.j2")


def text_of(template: str) -> str:
    """A file of the templates' folder."""
    return resources.files("isi.report").joinpath("templates", template).read_text("utf-8")


def of_each(experiments: Sequence[Experiment], content_of: Callable[[Experiment], Content | None]) -> Iterator[Content]:
    """The same of every experiment under its own names, with headings where there are several."""
    for place, experiment in enumerate(experiments):
        content = content_of(experiment)
        if content is not None:
            folded = " | folded" if place else ""
            heading = f"## {capitalized(experiment.title)}{folded}" if len(experiments) > 1 else ""
            title = experiment.title if experiment.suffix else ""
            yield replace(content, heading=heading, suffix=experiment.suffix, title=title)


def parsed(text: str, content: Content) -> Iterator[Block]:
    """The blocks of a template that was filled.

    Raises:
        KeyError: where it names a table or a figure that the content lacks.
    """
    items: dict[Any, Any] = {**content.numbers, **{(type(item), item.name): item for item in content.shown}}
    for part in re.split(r"\n\s*\n", text.strip()):
        first, *others = part.strip().split("\n")
        mark, _, rest = first.partition(" ")
        title, _, flag = (text.strip() for text in rest.partition(" | "))
        if not first:
            continue
        if mark == "#":
            yield Block("section", flag, title=title)
        elif mark == "##":
            yield Block("heading", title=title, folded=flag == "folded")
        elif mark == "-":
            yield Block(
                "list", items=[" ".join(item.split()) for item in re.split(r"^- ", part, flags=re.MULTILINE)[1:]]
            )
        elif mark.startswith("@"):
            name, (title, _, flag) = title, flag.partition(" | ")
            kind = {"@table": Table, "@figure": Figure}.get(mark)
            item = replace(items[kind, name], name=f"{name}{content.suffix}") if kind else items.get(name)
            if kind:
                title += f" ({content.title})" if content.title else ""
            yield Block(mark[1:], " ".join(" ".join(others).split()), (), title, flag == "folded", item)
        else:
            yield Block("paragraph", " ".join(part.split()))


_ENVIRONMENT = Environment(  # makes text, which the page escapes
    loader=PackageLoader("isi.report", "templates/sections"), undefined=StrictUndefined, trim_blocks=True,
    lstrip_blocks=True, autoescape=False,  # noqa: S701  # makes text, which the page escapes
)  # fmt: skip
_ENVIRONMENT.filters |= {
    "joined": words.joined, "with_values": words.with_values, "listed_epochs": words.listed_epochs, "label": label,
    "described": described, "capitalized": capitalized, "num": format,
    "labels": lambda models: words.joined(map(label, models)),
}  # fmt: skip
_ENVIRONMENT.globals["SCOPES"] = words.SCOPES
