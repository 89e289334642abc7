"""The words of the page, each with what it means: in one place, for the guide and for whoever asks at a word."""

from __future__ import annotations

import re
from collections.abc import Collection
from dataclasses import dataclass
from typing import TYPE_CHECKING

from markupsafe import Markup, escape

from isi.report.models import JOINT, described, label
from isi.report.wording import SCOPES

if TYPE_CHECKING:  # which is made of the same models
    from isi.report.results import Results


@dataclass(frozen=True)
class Term:
    """A word, and what it means."""

    name: str
    means: str
    #: other forms in which it stands in text
    forms: tuple[str, ...] = ()
    #: whether it is a word of its own in text; others only where they fill a cell of a table
    in_text: bool = True

    @property
    def id(self) -> str:
        """Where the page has it."""
        spelled = {"*": " star", "⁰": "0", "¹": "1", "ξ": "xi", "θ": "theta"}
        plain = "".join(spelled.get(sign, sign) for sign in self.name.lower())
        return "term-" + re.sub(r"[^a-z0-9]+", "-", plain).strip("-")


#: What is measured, and on what.
_MEASURES = (
    Term("MRR*", "How near the ranked answers come to what was observed, in points: 100 where every answer stands at "
         "its place, few where it stands anywhere. The place of an answer is told by how often each was observed; "
         "what was observed as often is interchangeable. It is the mean of two halves, one of queries that ask for "
         "entities and one of queries that ask for relations."),
    Term("asks for entities", "The half of MRR* whose queries hide the head or the tail of a triple. It is the half "
         "that takes knowledge of the entity.", ("entity half", "half that asks for entities")),
    Term("asks for relations", "The half of MRR* whose queries hide the relation of a triple. With few relations that "
         "is next to a choice of the right kind.", ("relation half", "half that asks for relations")),
    Term("asked about the novel entity", "Of the half that asks for entities, the queries that give the novel entity "
         "and ask what belongs to it. No vector can win them by scoring high against everything.",
         ("Asked about the novel entity",)),
    Term("interval", "Where 95 of 100 means would lie if the seeds were drawn again (percentiles of a bootstrap over "
         "seeds): in brackets in tables, bars and bands in figures.", ("intervals",)),
    Term("seed", "One repeat: its own split of the triples into training, validation and test, and its own novel "
         "entities.", ("seeds",)),
    Term("told apart", "A difference that chance makes in fewer than one of twenty such families of comparisons: a "
         "corrected p below 0.05.", ("n.s.",)),
    Term("p, corrected", "The p of the exact sign-flip test, raised for the number of pairs that are compared (Holm).",
         ("p (Holm)", "Holm-corrected p")),
    Term("epochs to convergence", "How many passes over everything it takes until MRR* is within a margin of the joint "
         "model's.", ("converged", "never converged, %", "Epochs to convergence")),
    Term("crowding", "Novel entities rank above the answers of earlier knowledge, which itself is as it was."),
    Term("damage", "Earlier knowledge itself has changed: it answers worse even where novel entities are no "
         "candidates."),
)  # fmt: skip
_SCOPES = (
    Term(SCOPES["all"], "Test triples, whatever they are about; most are about entities that were known before."),
    Term(SCOPES["novel"], "Every triple that touches a novel entity, but for those that it was inserted with.",
         ("about novel entities", "about the novel entities")),
    Term(SCOPES["novel_heldout"], "Triples that touch a novel entity and that nobody trains on: what is known of it at "
         "any epoch.", ("held-out triples of the novel entities", "held-out queries about novel entities")),
    Term(SCOPES["known"], "Test triples between entities that were known before, with novel entities among the "
         "candidates.", ("Earlier knowledge",)),
    Term(SCOPES["known_closed"], "The same with novel entities left out of the candidates: only training can change "
         "it.", ("Earlier knowledge by itself",)),
)  # fmt: skip
_WORLD = (
    Term("novel entity", "An entity that the embedding did not know. Here each was taken out of the graph before "
         "training, and then inserted.", ("novel entities", "Novel entities", "Novel entity")),
    Term("insert triples", "The few triples that are told of a novel entity when it is inserted: some of those it has "
         "with known entities, at random."),
    Term("initializer", "What gives a novel entity its first vector.", ("initializers", "Initializers", "Initializer")),
    Term("indicators", "The known entities whose mean the vector of a novel entity is.", ("indicator", "Indicators")),
    Term("Θ⁰", "The embedding before anything is inserted, trained on all that does not touch a novel entity."),
    Term("Θ¹", "The embedding with the novel entities in it."),
    Term("joint model", "Trained from the start on everything, novel entities included: what others are held "
         "against.", ("Joint model",)),
    Term("|ξ|", "How many novel entities are inserted at once."),
    Term("control", "An initializer that has a part of what ISI has, and no meaning.", ("controls", "Controls")),
    Term("ISI", "Incremental semantic initialization: ES, RS and ERS, the paper's initializers."),
)  # fmt: skip


def terms(results: Results) -> list[Term]:
    """All words that are explained."""
    return [*of_the_page(), *models(results)]


def of_the_page() -> list[Term]:
    """Words of the page, whatever was run."""
    return [*_WORLD, *_MEASURES, *_SCOPES]


def models(results: Results) -> list[Term]:
    """Every initializer that was run, and the joint model."""
    names = dict.fromkeys(name for one in results.experiments.values() for name in one.initializers)
    names |= dict.fromkeys(name for one in results.beyond.values() for name in one.initializers)
    joint = Term(label(JOINT), "The joint model: trained from the start on everything.", in_text=False)
    return [*map(_model, names), joint]


def _model(name: str) -> Term:
    """An initializer as it describes itself; in text only where its name is no plain word."""
    own = label(name)
    means = described(name).removeprefix(own).lstrip(",: ")
    return Term(own, means[:1].upper() + means[1:], in_text=own.isupper() or own == "Xavier")


class Marker:
    """Marks words where they first stand in a part of the page, as links to what they mean."""

    def __init__(self, words: Collection[Term]) -> None:
        self._seen: set[str] = set()
        self._of = {form: term for term in words for form in (term.name, *term.forms)}
        spelled = sorted((form for form, term in self._of.items() if term.in_text), key=len, reverse=True)
        either = "|".join(map(re.escape, spelled))
        self._pattern = re.compile(rf"(?<![\w*(>/])(?:{either})(?![\w*])") if spelled else None

    def anew(self) -> str:
        """Begin another part; nothing to be shown."""
        self._seen.clear()
        return ""

    def text(self, text: str) -> str:
        """Text that is markup already, with its words marked; what is within an element stays as it is."""
        if self._pattern is None:
            return text
        parts = re.split(r"(<(?:a|code)\b.*?</(?:a|code)>|<[^>]*>)", text)
        return "".join(part if place % 2 else self._pattern.sub(self._first, part) for place, part in enumerate(parts))

    def cell(self, text: str) -> Markup:
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
