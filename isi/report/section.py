"""A section of the page: a function gives its numbers, tables and figures,
a template its sentences and captions.

A template is text in blocks with empty lines between them. A block is a paragraph, or starts with
one of these::

    # TITLE [| open]                    the section's title; an open section is expanded at first
    ## TITLE                            a heading within the section
    - TEXT                              items of a list
    @table NAME | TITLE [| folded]      a table with the text below as its caption; likewise @figure
    @data NAME | TITLE                  links to a table's files, without the table
    @listing NAME | TITLE [| folded]    names and values; NAME is one of the section's numbers
    @terms NAME | TITLE [| folded]      words and their meanings
    @explorer NAME, @guide              parts of the page with templates of their own

In text, ```code```, ``**weight**``, ``[text](#section)`` and ``[text](address)`` are marked up; a
link to a section that the page does not have is plain text.
"""

import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from importlib import import_module
from math import nan
from typing import Any, Self

from jinja2 import Environment, PackageLoader, StrictUndefined
from matplotlib.figure import Figure as Canvas

from isi.report import words
from isi.report.data import Experiment, Results
from isi.report.figures import Figure
from isi.report.stats import LEVEL, values
from isi.report.tables import ReportTable


@dataclass(frozen=True)
class Content:
    """The content of a section, once or for each experiment:
    numbers for its template, tables and figures.
    """

    numbers: Mapping[str, Any] = field(default_factory=dict)
    #: rows by name (``ReportTable.of``), and figures; the template names them without the suffix
    tables: Mapping[str, Any] = field(default_factory=dict)
    figures: Mapping[str, Canvas] = field(default_factory=dict)
    #: end of the names of tables and figures; title of the experiment, put in brackets behind their
    #: titles
    suffix: str = ""
    title: str = ""
    #: whether the page only links to the files of the tables and figures
    only_files: bool = False


@dataclass(frozen=True)
class Block:
    """A block of a template: a paragraph, list or heading;
    or, after ``@``, a table, figure or numbers by name.
    """

    kind: str
    text: str = ""
    items: Sequence[str] = ()
    title: str = ""
    folded: bool = False
    content: Any = None


@dataclass(frozen=True)
class FilledSection:
    """A section as the page shows it; ``opened``: expanded at first;
    ``group``: its part of the page.
    """

    id: str
    title: str
    opened: bool
    blocks: Sequence[Block]
    group: str = ""


@dataclass(frozen=True)
class ReportSection:
    """A section: its function, and its template,
    which is ``text`` or else the file ``NAME.md.j2``.
    """

    name: str
    contents: Callable[[Results], Iterable[Content]]
    text: str | None = None
    group: str = ""

    @classmethod
    def of(cls, place: str, group: str = "") -> Self:
        """The section ``MODULE.FUNCTION``; its template is the ``TEXT`` of the module,
        if there is one.
        """
        module_name, _, name = place.rpartition(".")
        module = import_module(f"isi.report.sections.{module_name}")
        return cls(name, getattr(module, name), getattr(module, "TEXT", None), group)

    def filled(self, results: Results) -> FilledSection | None:
        """The section with its blocks; None if it has none."""
        template = (
            _ENVIRONMENT.from_string(self.text)
            if self.text
            else _ENVIRONMENT.get_template(f"{self.name}.md.j2")
        )
        title, flag, blocks = "", "", list[Block]()
        for number, content in enumerate(self.contents(results)):
            about = {"results": results, "params": results.params, "tables": content.tables}
            for block in parsed(
                template.render({**about, "first": number == 0, **content.numbers}), content
            ):
                if block.kind == "section":
                    title, flag = block.title, block.text
                elif block.kind == "list" and blocks and blocks[-1].kind == "list":
                    blocks[-1] = replace(block, items=[*blocks[-1].items, *block.items])
                else:
                    blocks.append(block)
        return (
            FilledSection(self.name.replace("_", "-"), title, flag == "open", blocks, self.group)
            if blocks
            else None
        )


def of_each(
    experiments: Iterable[Experiment], content_of: Callable[[Experiment], Content | None]
) -> Iterator[Content]:
    """The content of each experiment, with its suffix and title;
    the page shows that of the first, files have all.
    """
    contents = [
        (experiment, content)
        for experiment in experiments
        if (content := content_of(experiment)) is not None
    ]
    for place, (experiment, content) in enumerate(contents):
        yield replace(
            content,
            numbers={"experiment": experiment, **content.numbers},
            suffix=experiment.suffix,
            title=experiment.title if experiment.suffix else "",
            only_files=place > 0,
        )


def of_each_graph(
    contents: Callable[[Results, Experiment], Content | None],
) -> Callable[[Results], Iterator[Content]]:
    """Decorate a section's function of one experiment,
    to apply it to every experiment with one source.
    """
    return lambda results: of_each(
        results.standalone, lambda experiment: contents(results, experiment)
    )


def parsed(text: str, content: Content) -> Iterator[Block]:
    """The blocks of a rendered template, with the tables,
    figures and numbers of ``content`` that they name.
    """
    for part in filter(None, map(str.strip, re.split(r"\n\s*\n", text))):
        first, *others = part.split("\n")
        mark, _, rest = first.partition(" ")
        title, _, flag = (text.strip() for text in rest.partition(" | "))
        if mark == "#":
            yield Block("section", flag, title=title)
        elif mark in ("@table", "@figure", "@data"):
            name, (title, _, flag) = title, flag.partition(" | ")
            title += f" ({content.title})" if content.title else ""
            drawn = mark == "@figure"
            made: Any = (Figure, content.figures) if drawn else (ReportTable.of, content.tables)
            kind = "data" if content.only_files else mark[1:]
            text = " ".join(" ".join(others).split())
            yield Block(
                kind,
                text,
                (),
                title,
                flag == "folded",
                made[0](f"{name}{content.suffix}", made[1][name]),
            )
        elif content.only_files:
            continue
        elif mark.startswith("@"):
            name, (title, _, flag) = title, flag.partition(" | ")
            yield Block(mark[1:], "", (), title, flag == "folded", content.numbers.get(name))
        elif mark == "##":
            yield Block("heading", title=title)
        elif mark == "-":
            texts = re.split(r"^- ", part, flags=re.MULTILINE)[1:]
            yield Block("list", items=[" ".join(text.split()) for text in texts])
        else:
            yield Block("paragraph", " ".join(part.split()))


_ENVIRONMENT = Environment(
    loader=PackageLoader("isi.report", "templates/sections"),
    undefined=StrictUndefined,
    trim_blocks=True,
    lstrip_blocks=True,
    autoescape=False,  # noqa: S701  # renders text; the page escapes it
)
_FILTERS = (
    words.joined,
    words.with_values,
    words.listed_epochs,
    words.label,
    words.described,
    words.capitalized,
    words.isi,
    words.contenders,
    words.controls,
)
_ENVIRONMENT.filters |= {function.__name__: function for function in _FILTERS} | {
    "num": format,
    "values_of": values,
    "labels": lambda models: words.joined(map(words.label, models)),
}
_ENVIRONMENT.globals |= {name: getattr(words, name) for name in ("SCOPES", "BASELINE", "JOINT")} | {
    "LEVEL": LEVEL,
    "nan": nan,
}
