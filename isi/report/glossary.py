"""The glossary of the page: its terms with their meanings, for the guide and for tooltips."""

import re
from collections.abc import Collection
from dataclasses import dataclass

from markupsafe import Markup, escape

from isi.report.data import Results
from isi.report.words import JOINT, TEMPLATES, capitalized, described, label


@dataclass(frozen=True)
class Term:
    """A glossary term and its meaning; ``in_text``: marked within sentences too,
    not only as a whole table cell.
    """

    name: str
    means: str
    #: other spellings that are marked as this term
    forms: tuple[str, ...] = ()
    in_text: bool = True

    @property
    def id(self) -> str:
        """The HTML id of the term's meaning."""
        spelled = {"*": " star", "⁰": "0", "¹": "1", "ξ": "xi", "θ": "theta"}
        plain = "".join(spelled.get(sign, sign) for sign in self.name.lower())
        return "term-" + re.sub(r"[^a-z0-9]+", "-", plain).strip("-")


def of_the_page() -> list[Term]:
    """The terms of ``glossary.txt``: each entry is a line ``NAME | FORM | ...``,
    then lines of its meaning.
    """
    text = (TEMPLATES / "glossary.txt").read_text("utf-8")
    entries = [entry.split("\n") for entry in text.strip().split("\n\n")]
    names = [heading.split(" | ") for heading, *_ in entries]
    return [
        Term(name, " ".join(meaning), tuple(forms))
        for (name, *forms), (_, *meaning) in zip(names, entries, strict=True)
    ]


def of_models(results: Results) -> list[Term]:
    """A term for each initializer that was run, with its registered description,
    and one for the joint model.
    """
    titles = {
        name: label(name) for runs in results.experiments.values() for name in runs.initializers
    }
    meanings = {
        name: described(name).removeprefix(title).lstrip(",: ") for name, title in titles.items()
    }
    terms = [
        Term(title, capitalized(meanings[name]), in_text=title.isupper() or title == "Xavier")
        for name, title in titles.items()
    ]
    return [
        *terms,
        Term(
            label(JOINT), "The joint model: trained from scratch on the whole graph.", in_text=False
        ),
    ]


class Marker:
    """Replaces the first occurrence of each term in a section of the page
    by a link to its meaning.
    """

    def __init__(self, words: Collection[Term]) -> None:
        self._seen: set[str] = set()
        self._of = {form: term for term in words for form in (term.name, *term.forms)}
        spelled = sorted(
            (form for form, term in self._of.items() if term.in_text), key=len, reverse=True
        )
        either = "|".join(map(re.escape, spelled))
        self._pattern = re.compile(rf"(?<![\w*(>/])(?:{either})(?![\w*])") if spelled else None

    def anew(self) -> str:
        """Begin a new section; returns "", since a template prints the value of a call."""
        self._seen.clear()
        return ""

    def text(self, text: str) -> str:
        """HTML with its terms marked, except within links and code."""
        if self._pattern is None:
            return text
        parts = re.split(r"(<(?:a|code)\b.*?</(?:a|code)>|<[^>]*>)", text)
        return "".join(
            part if place % 2 else self._pattern.sub(lambda word: self.cell_text(word[0]), part)
            for place, part in enumerate(parts)
        )

    def cell_text(self, text: str) -> Markup:
        """A text as HTML: a link if the whole text is a term that the
        section has not linked yet.
        """
        term = self._of.get(text)
        if term is None or term.id in self._seen:
            return escape(text)
        self._seen.add(term.id)
        return Markup(f'<a class="term" href="#{term.id}">{escape(text)}</a>')  # noqa: S704
