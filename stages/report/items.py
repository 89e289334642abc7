"""The pages of the report: their parts, and their tables and figures (``items.yaml``)."""

from pathlib import Path
from typing import Annotated

from pydantic import Field

from isi import config
from isi.config import Section


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
_FILE = Path(__file__).with_name("items.yaml")
#: All pages by name.
PAGES: dict[str, Page] = config.check(config.read(_FILE), dict[str, Page], "", _FILE)
