"""What a section of the page is made of, and how one says the same of several experiments."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import pandas as pd
from jinja2.utils import htmlsafe_json_dumps
from markupsafe import Markup
from matplotlib.figure import Figure as Canvas

from isi.report.glossary import Term
from isi.report.prose import capitalized
from isi.report.results import Experiment, Results


@dataclass(frozen=True)
class Table:
    """A table as shown: numbers are in the units that its caption names.

    Where the 95 % interval of a column ends stands in two more, of its name with ``LOW`` and ``HIGH`` of
    ``statistics`` behind it; on the page, in Markdown and in LaTeX the three are one.
    """

    name: str
    title: str
    caption: str
    frame: pd.DataFrame
    #: of columns that are not shown as other numbers are, how
    formats: Mapping[str, Callable[[Any], str]] = field(default_factory=dict)
    #: shown when asked for
    folded: bool = False
    #: columns of which files keep digits rather than decimals (``steady.csv``)
    of_any_size: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class Figure:
    """A drawn figure. What it shows is told in words by what was drawn (``figures.in_words``)."""

    name: str
    title: str
    caption: str
    canvas: Canvas


@dataclass(frozen=True)
class Heading:
    """Opens a part of a section."""

    text: str
    #: the part is shown when asked for
    folded: bool = False


@dataclass(frozen=True)
class Written:
    """A template of its own, which needs nothing but itself."""

    template: str


@dataclass(frozen=True)
class Words:
    """Words with what they mean."""

    title: str
    terms: Sequence[Term]
    folded: bool = False


@dataclass(frozen=True)
class Bullets:
    """Paragraphs that are items of a list."""

    texts: Sequence[str]


@dataclass(frozen=True)
class Listing:
    """Names and values, on the page alone."""

    title: str
    values: Mapping[str, Any]
    folded: bool = True


@dataclass(frozen=True, eq=False)
class Explorer:
    """What a reader looks through by a script, on the page alone (``templates/explorer.js`` reads the data)."""

    data: Mapping[str, Any]

    @property
    def json(self) -> Markup:
        """The data for an element of the page, which no text of theirs can end."""
        return htmlsafe_json_dumps(self.data, separators=(",", ":"))


#: A string is a paragraph. In it and in bullets, ```code```, ``[text](#section)`` and ``[text](https://…)`` are marked
#: up; a link to a section that the page does not have is plain text.
Content = str | Heading | Bullets | Listing | Table | Figure | Written | Words | Explorer


@dataclass(frozen=True)
class Section:
    """A part of the page: what it holds, in order, made from the results. Without contents it is left out."""

    id: str
    title: str
    contents: Callable[[Results], Iterable[Content]]
    #: shown at first; others when asked for
    opened: bool = False
    #: the part of the page that it belongs to
    group: str = ""


def by_experiment(results: Results, contents: Callable[[Results, Experiment], Iterable[Content]]) -> Iterator[Content]:
    """The same contents of every experiment with a graph of its own, under headings where there are several."""
    for place, experiment in enumerate(results.own):
        if len(results.own) > 1:
            yield Heading(capitalized(experiment.title), folded=place > 0)
        for content in contents(results, experiment):
            yield belonging(content, experiment)


def belonging(content: Content, experiment: Experiment) -> Content:
    """Contents with an experiment's own names and titles; those of the first are as they are."""
    if experiment.suffix and isinstance(content, Table | Figure):
        title = f"{content.title} ({experiment.title})"
        return replace(content, name=f"{content.name}{experiment.suffix}", title=title)
    return content
