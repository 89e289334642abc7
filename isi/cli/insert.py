"""Give a new entity a vector from what is known of it, and say what the embedding makes of it."""

from __future__ import annotations

import argparse
import pkgutil
from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import isi
from isi.cli import _embedding as shared
from isi.cli._setting import setting
from isi.errors import InputError

if TYPE_CHECKING:
    from isi.bundle.answers import Answer, Question
    from isi.bundle.indicators import Indicator
    from isi.bundle.insert_entity import InsertedEntity, NewEntity
    from isi.bundle.query import OpenBundle
    from isi.insertion.interference import Interference
    from isi.insertion.result import Entity


#: Characters of a name, at most.
LONGEST = 200
#: Chance from which on an answer may surprise, and of how many of each question it is looked at.
LIKELY, LOOKED_AT = 0.2, 20


def configure(parser: argparse.ArgumentParser) -> None:
    """Its arguments."""
    parser.add_argument("name", metavar="NAME", help="of the new entity")
    parser.add_argument(
        "--fact", nargs=2, metavar=("RELATION", "ENTITY"), action="append", default=[],
        help="a triple of it: NAME RELATION ENTITY; as often as you like",
    )  # fmt: skip
    parser.add_argument(
        "--inverse-fact", nargs=2, metavar=("ENTITY", "RELATION"), action="append", default=[],
        help="a triple that ends with it: ENTITY RELATION NAME",
    )  # fmt: skip
    parser.add_argument("--definition", metavar="TEXT", help="what it is, in a sentence")
    parser.add_argument("--kind", metavar="KIND", help="of the embedding's kinds, for initializers that go by kinds")
    parser.add_argument(
        "--initializer", metavar="NAME",
        help=f"what puts it there, one of {', '.join(_initializers())}; if none, the best for what is known",
    )  # fmt: skip
    parser.add_argument(
        "--set", metavar="KEY=VALUE", action="append", default=[], type=setting,
        help="an option of that initializer, in place of its default (docs/insert_reference.md)",
    )  # fmt: skip
    parser.add_argument("--vectors", metavar="FILE", type=Path, help="word2vec or GloVe vectors for all phrases")
    parser.add_argument("--seed", metavar="S", type=_seed, default=0, help="of initializers that draw (default: 0)")
    parser.add_argument("--out", metavar="DIR", type=shared.out_folder, help="write the enlarged embedding there")
    shared.add_arguments(parser)


def _initializers() -> list[str]:
    """Names of those that ship: their modules, of which none is imported."""
    return [found.name for found in pkgutil.iter_modules([str(Path(isi.__path__[0]) / "initializers")])]


def _seed(text: str) -> int:
    if not text.isdecimal() or len(text) > 9:
        raise argparse.ArgumentTypeError(f"expected a whole number, got {text[:40]!r}")
    return int(text)


@dataclass(frozen=True)
class InsertReport:
    """All that is said of an insertion."""

    placed: InsertedEntity
    words: str
    #: facts that no known one is like
    odd: list[str]
    shown: list[Indicator]
    #: of each question: those that are shown, and more in which surprises may be
    answers: list[tuple[Question, list[Answer]]]
    top: int
    report: Entity
    interference: Interference | None

    @property
    def model(self) -> OpenBundle:
        return self.placed.model

    @property
    def surprises(self) -> list[tuple[Question, Answer]]:
        """Answers that would surprise, those of the best chance first."""
        found = [(asked, one) for asked, answers in self.answers for one in answers[:LOOKED_AT] if surprising(one)]
        return sorted(found, key=lambda pair: -(pair[1].chance or 0))


def surprising(answer: Answer) -> bool:
    """Whether it is not unlikely (without chances: the best), and no indicator is known to have it, nor was it told."""
    likely = answer.rank == 1 if answer.chance is None else answer.chance >= LIKELY
    return likely and not answer.known and answer.had_by == []


def run(arguments: argparse.Namespace) -> None:
    """Insert, ask, tell, and write.

    Raises:
        InputError: where the embedding is broken, a name is unknown, or nothing is known of the new entity.
    """
    from isi.bundle.insert_entity import insert_entity

    model = shared.open_folder(arguments.embedding)
    worded, news, said = _news(model, arguments)
    if arguments.out:
        shared.refuse_to_lose(arguments.out, {*model.entity_ids, news.name})
    with shared.as_option(initializer=arguments.initializer):
        placed = insert_entity(worded, news)
    told = _told(placed, said, list(_odd(model, news)), arguments.top)
    text = shared.as_json(_as_json(told)) if arguments.json else "\n".join(_lines(told))
    if arguments.out:
        from isi.bundle.folder import write

        write(arguments.out, placed.model.kept)
        text += "" if arguments.json else f"\nwritten: {arguments.out}"
    print(text)


def _news(model: OpenBundle, arguments: argparse.Namespace) -> tuple[OpenBundle, NewEntity, str]:
    """The embedding with word vectors, what is told, and what is to be said of the word vector."""
    from isi.bundle.folder import cell_fault, fault
    from isi.bundle.insert_entity import NewEntity
    from isi.bundle.query import alike, plain
    from isi.bundle.words import worded

    name, phrase = arguments.name, plain(arguments.name)
    for option, text, wrong in (
        ("NAME", name, fault), ("--definition", arguments.definition, cell_fault),
        ("--vectors", arguments.vectors and str(arguments.vectors), cell_fault),
    ):  # fmt: skip
        if text is not None and (said := wrong(text)):
            raise InputError(option, "", said)
    if len(name) > LONGEST:
        raise InputError("NAME", "", f"expected at most {LONGEST} characters, got {len(name):,}")
    same = [known for known in model.entity_ids if alike(known, name)]
    if same:
        raise InputError("NAME", "", f"expected a new name: {same[0]!r:.80} is known (see isi ask, isi nearest)")
    facts = [
        (name, *_names(model, relation, entity, "--fact")) for relation, entity in arguments.fact
    ] + [
        (*reversed(_names(model, relation, entity, "--inverse-fact")), name)
        for entity, relation in arguments.inverse_fact
    ]  # fmt: skip
    options = dict(arguments.set)
    if options and arguments.initializer is None:
        raise InputError("--set", "", "expected an --initializer, whose options these are")
    if len(options) < len(arguments.set):
        raise InputError("--set", "", "expected each option once")
    kind = _kind(model, arguments.kind)
    words = worded(model.kept, phrase, arguments.definition, arguments.vectors)
    if not facts and words.vector is None and arguments.initializer is None:
        expected = f"expected a --fact, an --inverse-fact or a word vector, and it has none: {words.said}"
        raise InputError(repr(name), "", expected)
    kept = model.kept
    if arguments.vectors:
        about = kept.about.model_copy(update={"words": words.source})
        model = replace(model, kept=replace(kept, about=about, words=words.known))
    news = NewEntity(
        name, phrase, kind, facts, arguments.definition, words.vector,
        arguments.initializer, options, arguments.seed,
    )  # fmt: skip
    return model, news, words.said


def _names(model: OpenBundle, relation: str, entity: str, option: str) -> tuple[str, str]:
    """A relation and an entity as they are written in the embedding."""
    kept = model.kept
    return kept.relation_names[model.relation(relation, option)], kept.entity_names[model.entity(entity, option)]


def _kind(model: OpenBundle, kind: str | None) -> str:
    from isi.bundle.query import find

    if kind is None:
        return ""
    kinds = {one: row for row, one in enumerate(dict.fromkeys(filter(None, model.kept.kinds)))}
    return list(kinds)[find(kind, kinds, "--kind", "a kind of this embedding")]


def _odd(model: OpenBundle, news: NewEntity) -> Iterator[str]:
    """Facts whose known end is of a kind that no known triple of the relation has there."""
    from isi.graph.graph import HEAD, TAIL

    for head, relation, tail in dict.fromkeys(news.facts):
        slot, end, what = (TAIL, tail, "a tail") if head == news.name else (HEAD, head, "a head")
        kind = model.kept.kinds[model.entity_ids[end]]
        there = {model.kept.kinds[row] for row in model.stands_in(model.relation_ids[relation], slot)}
        if kind and there and not {"", kind} & there:
            yield f"no known triple of {relation} has {what} of kind {kind}, as {end} is"


def _told(placed: InsertedEntity, words: str, odd: list[str], top: int) -> InsertReport:
    from tqdm import tqdm

    from isi.bundle.answers import Asker, worth_asking
    from isi.bundle.calibration import HeldOutCalibration

    model, shown = placed.model, placed.indicators()
    weights = {one.entity: one.weight or 1.0 for one in shown}
    asker = Asker(model, HeldOutCalibration(model, placed))
    asked = tqdm(worth_asking(model, placed.entity, weights), "asked", leave=False, disable=None)
    known = len(placed.done.known_triples) > 0
    answers = [(one, asker.ask(one, max(top, LOOKED_AT), weights if known else None)) for one in asked]
    interference = placed.done.interference() if known else None
    return InsertReport(placed, words, odd, shown, answers, top, placed.done.report(top)[0], interference)


def _lines(told: InsertReport) -> Iterator[str]:
    from isi.bundle.answers import MOST

    record, model, report = told.placed.record, told.model, told.report
    yield f"{record.entity}: inserted by {record.initializer} ({record.why})"
    if record.fallback:
        yield f"  which lacked what it goes by: {record.fallback} served"
    yield f"  triples: {report.insert_triples} told"
    yield from (f"  note: {odd}" for odd in told.odd)
    yield f"  words: {f'none; {told.words}: goes by relations' if _wordless(told) else f'a vector {told.words}'}"
    yield from shared.indicator_lines(model, told.shown)
    yield f"answers ({shared.meaning((one for _, answers in told.answers for one in answers), inserted=True)})"
    chosen = any(one.weight is not None for one in told.shown)
    for question, answers in told.answers:
        best = answers[: told.top]
        yield f"  {' '.join(shared.asked(model, question))}"
        yield from shared.answer_lines(best, [_note(answer, chosen) for answer in best])
    if len(told.answers) == MOST:
        yield "  (of other relations, see isi ask)"
    yield f"would surprise: {_surprising(told, 'an indicator' if chosen else 'one of the most similar')}"
    near = ", ".join(f"{name} ({cosine:.2f})" for name, cosine in report.nearest)
    yield f"nearest: {near}"
    yield (
        f"distance from the centre of the known: {report.distance:.2f} of what is usual, farther than"
        f" {shared.percent(report.farther_than)} of them"
    )
    yield _interfering(told.interference)


def _wordless(told: InsertReport) -> bool:
    words = told.model.kept.words
    return words is None or not words[told.placed.entity].any()


def _surprising(told: InsertReport, like: str) -> str:
    """The best of what would surprise."""
    if told.interference is None:
        return "unknown, since the embedding has no known triples to ask about"
    found = [_as_triple(told.model, question, answer) for question, answer in told.surprises]
    more = [f"and {len(found) - told.top} more"] * (len(found) > told.top)
    return "; ".join(found[: told.top] + more) or f"nothing that is likely: each such answer was told, or {like} has it"


def _note(answer: Answer, chosen: bool) -> str:
    if answer.known:
        return "told"
    if answer.had_by:
        more = f" and {len(answer.had_by) - 1} more" * (len(answer.had_by) > 1)
        return f"as {answer.had_by[0]}{more}"
    nobody = "no indicator has it" if chosen else "none of the most similar has it"
    return "" if answer.had_by is None else nobody


def _as_triple(model: OpenBundle, question: Question, answer: Answer) -> str:
    triple = " ".join(part if part != "?" else answer.entity for part in shared.asked(model, question))
    return triple if answer.chance is None else f"{triple} ({shared.percent(answer.chance)})"


def _interfering(found: Interference | None) -> str:
    if found is None:
        return "interference: unknown, since the embedding has no known triples to ask about"
    return (
        f"interference: of {found.queries} questions about known triples it outranks the answer in"
        f" {100 * found.above[0]:.1f} %; their mean reciprocal rank was {found.mrr_before:.3f}"
        f" and is {found.mrr_after:.3f}"
    )


def _as_json(told: InsertReport) -> dict[str, Any]:
    record, model, report = told.placed.record, told.model, told.report
    asked = [
        {
            "question": list(shared.asked(model, question)),
            "answers": [
                shared.answer_json(one) | {"had_by": one.had_by, "surprising": surprising(one)}
                for one in answers[: told.top]
            ],
        }
        for question, answers in told.answers
    ]
    return {
        "entity": record.entity, "id": told.placed.entity, "initializer": record.initializer, "why": record.why,
        "fallback": record.fallback, "options": dict(told.placed.done.options),
        "told": [list(fact) for fact in record.told], "words": None if _wordless(told) else told.words,
        "notes": told.odd, "indicators": [shared.indicator_json(model, one) for one in told.shown], "answers": asked,
        "surprises": None if told.interference is None else [
            {"triple": [part if part != "?" else one.entity for part in shared.asked(model, question)],
             "chance": one.chance} for question, one in told.surprises
        ],
        "nearest": [{"entity": name, "cosine": cosine} for name, cosine in report.nearest],
        "distance": report.distance, "farther_than": report.farther_than,
        "interference": None if told.interference is None else asdict(told.interference),
    }  # fmt: skip
