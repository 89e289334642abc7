"""A section of the page: a function gives its numbers, tables and figures,
a template its sentences and captions.

A template is text in blocks with empty lines between them. A block is a paragraph or a list of
Markdown (of which only lists, ```code```, ``**weight**`` and ``[links](address)`` are marked up; a
link to a section that the page does not have is plain text), or starts with one of these::

    # TITLE [| open]                    the section's title; an open section is expanded at first
    @table NAME | TITLE [| folded]      a table with the text below as its caption; likewise @figure
    @data NAME | TITLE                  a table's files in the section's list of further ones
    @listing NAME | TITLE [| folded]    names and values; NAME is one of the section's numbers
    @terms NAME | TITLE [| folded]      words and their meanings
    @picture NAME, @explorer NAME, @guide    parts of the page with templates of their own
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
from isi.report.figures import Chart, Figure
from isi.report.stats import LEVEL, values
from isi.report.tables import ReportTable

Numbers = dict[str, Any]  #: Values for a template, by name.
Tables = dict[str, Any]  #: Rows (``ReportTable.of``) by name of table.
Figures = dict[str, Canvas | Chart]


@dataclass(frozen=True)
class Content:
    """The content of a section, once or for each experiment:
    numbers for its template, tables and figures.
    """

    numbers: Numbers = field(default_factory=dict)
    #: rows by name (``ReportTable.of``), and figures; the template names them without the suffix
    tables: Tables = field(default_factory=dict)
    figures: Mapping[str, Canvas | Chart] = field(default_factory=dict)
    #: end of the names of tables and figures; title of the experiment, put in brackets behind their
    #: titles
    suffix: str = ""
    title: str = ""
    #: whether the page only links to the files of the tables and figures
    only_files: bool = False


Contents = Iterator[Content]


@dataclass(frozen=True)
class Block:
    """A block of a template: ``prose``, or what stands after ``@``, with its caption as text;
    ``content``: the table, figure or numbers that it names.
    """

    kind: str
    text: str = ""
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
        heading, blocks = Block("section"), list[Block]()
        for content in self.contents(results):
            about = {"results": results, "params": results.params, "tables": content.tables}
            text = template.render(about | content.numbers)
            heading, *others = parsed(text, content)
            blocks += others
        if not blocks:
            return None
        name = self.name.replace("_", "-")
        return FilledSection(name, heading.title, heading.text == "open", blocks, self.group)


def of_each(
    experiments: Iterable[Experiment], content_of: Callable[[Experiment], Content | None]
) -> Contents:
    """The content of each experiment, with its suffix and title;
    the page shows that of the first, files have all.
    """
    only_files = False
    for experiment in experiments:
        content = content_of(experiment)
        if content is not None:
            yield replace(
                content,
                numbers={"experiment": experiment, **content.numbers},
                suffix=experiment.suffix,
                title=experiment.title if experiment.suffix else "",
                only_files=only_files,
            )
            only_files = True


def of_each_graph(
    contents: Callable[[Results, Experiment], Content | None],
) -> Callable[[Results], Contents]:
    """Decorate a section's function of one experiment,
    to apply it to every experiment with one source.
    """
    return lambda results: of_each(
        results.standalone, lambda experiment: contents(results, experiment)
    )


def parsed(text: str, content: Content) -> Iterator[Block]:
    """The blocks of a rendered template, the section's title first."""
    heading, *parts = filter(None, map(str.strip, re.split(r"\n\s*\n", text)))
    title, _, flag = heading.removeprefix("# ").partition(" | ")
    yield Block("section", flag, title)
    for part in parts:
        if part.startswith("@"):
            block = _named(part, content)
        else:  # each item of a list on one line
            block = Block("prose", re.sub(r"\s+(?!- )", " ", part))
        if block.kind == "data" or not content.only_files:
            yield block


def _named(part: str, content: Content) -> Block:
    """A block after ``@``, with what it names."""
    mark, _, caption = part.removeprefix("@").partition("\n")
    kind, _, rest = mark.partition(" ")
    name, title, flag, *_ = [*rest.split(" | "), "", ""]
    folded, file = flag == "folded", f"{name}{content.suffix}"
    item: Figure | ReportTable
    if kind == "figure":
        item = Figure.of(file, content.figures[name])
    elif kind in ("table", "data"):
        item = ReportTable.of(file, content.tables[name])
    else:
        text = " ".join(caption.split())
        return Block(kind, text, title, folded, content.numbers.get(name))
    title += f" ({content.title})" if content.title else ""
    kind = "data" if content.only_files else kind
    return Block(kind, " ".join(caption.split()), title, folded, item)


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
    words.label,
    words.described,
    words.capitalized,
    words.isi,
    words.contenders,
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
