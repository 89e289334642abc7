"""The words of the page with their meanings: for the guide, and for whoever points at a word."""

from __future__ import annotations

import re
from collections.abc import Collection
from dataclasses import dataclass

from markupsafe import Markup, escape

from isi.report.data import Results
from isi.report.models import JOINT, described, label
from isi.report.section import text_of


@dataclass(frozen=True)
class Term:
    """A word, and what it means."""

    name: str
    means: str
    #: other forms in which it stands in text
    forms: tuple[str, ...] = ()
    #: whether it is marked within text; others only where they fill a cell of a table
    in_text: bool = True

    @property
    def id(self) -> str:
        """Where the page has it."""
        spelled = {"*": " star", "⁰": "0", "¹": "1", "ξ": "xi", "θ": "theta"}
        plain = "".join(spelled.get(sign, sign) for sign in self.name.lower())
        return "term-" + re.sub(r"[^a-z0-9]+", "-", plain).strip("-")


def terms(results: Results) -> list[Term]:
    """All words that are explained."""
    return [*of_the_page(), *models(results)]


def of_the_page() -> list[Term]:
    """Words of the page, whatever was run: of ``glossary.txt``, where a term stands above its meaning."""
    found = []
    for entry in text_of("glossary.txt").strip().split("\n\n"):
        (name, *forms), meaning = entry.split("\n")[0].split(" | "), entry.split("\n")[1:]
        found.append(Term(name, " ".join(meaning), tuple(forms)))
    return found


def models(results: Results) -> list[Term]:
    """Every initializer that was run, and the joint model."""
    names = dict.fromkeys(name for one in results.experiments.values() for name in one.initializers)
    names |= dict.fromkeys(name for one in results.variants.values() for name in one.initializers)
    joint = Term(label(JOINT), "The joint model: trained from the start on everything.", in_text=False)
    return [*map(_model, names), joint]


def _model(name: str) -> Term:
    """An initializer as it describes itself; in text only where its label is no plain word."""
    title = label(name)
    means = described(name).removeprefix(title).lstrip(",: ")
    return Term(title, means[:1].upper() + means[1:], in_text=title.isupper() or title == "Xavier")


class Marker:
    """Marks words where they first stand in a section of the page, as links to their meanings."""

    def __init__(self, words: Collection[Term]) -> None:
        self._seen: set[str] = set()
        self._of = {form: term for term in words for form in (term.name, *term.forms)}
        spelled = sorted((form for form, term in self._of.items() if term.in_text), key=len, reverse=True)
        either = "|".join(map(re.escape, spelled))
        self._pattern = re.compile(rf"(?<![\w*(>/])(?:{either})(?![\w*])") if spelled else None

    def anew(self) -> str:
        """Begin another section; nothing to be shown."""
        self._seen.clear()
        return ""

    def text(self, text: str) -> str:
        """Markup with its words marked; text within a link or code stays as it is."""
        if self._pattern is None:
            return text
        parts = re.split(r"(<(?:a|code)\b.*?</(?:a|code)>|<[^>]*>)", text)
        return "".join(part if place % 2 else self._pattern.sub(self._first, part) for place, part in enumerate(parts))

    def cell_text(self, text: str) -> Markup:
        """The text of a cell, which is a word as a whole or none."""
        term = self._of.get(text)
        return Markup(self._link(term, text) if term else escape(text))  # noqa: S704

    def _first(self, place: re.Match[str]) -> str:
        return self._link(self._of[place[0]], place[0])

    def _link(self, term: Term, shown: str) -> str:
        if term.id in self._seen:
            return str(escape(shown))
        self._seen.add(term.id)
        return f'<a class="term" href="#{term.id}">{escape(shown)}</a>'
