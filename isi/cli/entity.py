"""Commands about entities of a bundle: ``isi insert``, ``isi ask``, ``isi nearest``, ``isi explain``."""

from __future__ import annotations

import json as json_format
from collections.abc import Collection, Iterator, Sequence
from dataclasses import asdict, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Parameter

from isi.cli import text
from isi.cli.app import DEFAULT, FROM_ZERO, Embedding, Json, Out, Settings, Top, flags, settings, show
from isi.errors import InputError
from isi.tables import paths

if TYPE_CHECKING:
    from isi.bundle.answers import Answer
    from isi.bundle.insert_entity import InsertedEntity, NewEntity
    from isi.bundle.query import OpenBundle, Query
    from isi.bundle.words import PhraseVector

#: Characters of a name, at most.
LONGEST = 200
#: Probability from which on an answer may be unexpected, and the number of best answers to a query that are examined.
LIKELY, EXAMINED = 0.2, 20
Pair = tuple[str, str]


def insert(
    name: str, *,
    fact: Annotated[tuple[Pair, ...], Parameter(help="RELATION ENTITY: the triple NAME RELATION ENTITY is known")] = (),
    inverse_fact: Annotated[
        tuple[Pair, ...], Parameter(help="ENTITY RELATION: the triple ENTITY RELATION NAME is known")
    ] = (),
    definition: Annotated[str | None, Parameter(help="what it is, in a sentence")] = None,
    kind: Annotated[str | None, Parameter(help="one of the bundle's kinds, for initializers that use kinds")] = None,
    initializer: Annotated[str | None, Parameter(help="by default the best for what is given")] = None,
    set: Annotated[Settings, Parameter(help="KEY=VALUE: an option of that initializer")] = (),
    vectors: Annotated[Path | None, Parameter(help="file of word2vec or GloVe vectors for all phrases")] = None,
    seed: Annotated[int, Parameter(validator=FROM_ZERO, help="of initializers that draw at random")] = 0,
    out: Out = None, embedding: Embedding = DEFAULT, top: Top = 5, json: Json = False,
) -> None:  # fmt: skip
    """Insert an entity and report what the bundle predicts about it.

    Raises:
        InputError: where the bundle is broken, a name is unknown, or nothing is given about the entity.
    """
    from isi.bundle.folder import write
    from isi.bundle.insert_entity import NewEntity, insert_entity
    from isi.bundle.names import plain

    opened = open_folder(embedding)
    _check_new_name(opened, name)
    _check_text("--definition", definition)
    _check_text("--vectors", str(vectors) if vectors else None)
    triples = [(name, *_names(opened, relation, entity, "--fact")) for relation, entity in fact]
    inverse = [_names(opened, relation, entity, "--inverse-fact") for entity, relation in inverse_fact]
    triples += [(entity, relation, name) for relation, entity in inverse]
    options = settings(set)
    if options and initializer is None:
        raise InputError("--set", "", "expected an --initializer, whose options these are")
    kind = _kind(opened, kind)
    opened, words = _with_words(opened, plain(name), definition, vectors)
    if not triples and words.vector is None and initializer is None:
        expected = f"expected a --fact, an --inverse-fact or a word vector, and it has none: {words.note}"
        raise InputError(repr(name), "", expected)
    new = NewEntity(name, plain(name), kind, triples, definition, words.vector, initializer, options, seed)
    if out:
        refuse_to_lose(out, {*opened.entity_ids, name})
    with flags(initializer, initializer="--initializer", entities="--embedding"):
        inserted = insert_entity(opened, new)
    answer = _insertion(inserted, words.note, list(_unusual(opened, new)), top)
    if out:
        write(out, inserted.opened.bundle)
    show(answer, json, partial(text.insertion, top=top))
    if out and not json:
        print(f"written: {out}")


def ask(
    entity: Annotated[str | None, Parameter(help="the head; the answer is the tail")] = None,
    of: Annotated[str | None, Parameter(name="RELATION", help="the relation")] = None, *,
    head: Annotated[str | None, Parameter(help="the same as ENTITY")] = None,
    relation: Annotated[str | None, Parameter(help="the same as RELATION")] = None,
    tail: Annotated[str | None, Parameter(help="the tail; the answer is the head")] = None,
    embedding: Embedding = DEFAULT, top: Top = 10, json: Json = False,
) -> None:  # fmt: skip
    """Rank the answers of one query.

    Raises:
        InputError: where the bundle is broken, a name is unknown, or not one end and the relation are given.
    """
    for option, first, second in (("--head", entity, head), ("--relation", of, relation)):
        if first is not None and second is not None:
            raise InputError(option, "", "given both as option and as positional argument")
    head, relation = entity or head, of or relation
    if relation is None or (head is None) == (tail is None):
        raise InputError("", "", "expected ENTITY RELATION, or --relation RELATION --tail ENTITY")
    opened = open_folder(embedding)
    from isi.bundle.answers import answer
    from isi.bundle.calibration import HeldOutCalibration
    from isi.bundle.explain import again
    from isi.bundle.query import Query
    from isi.graph.graph import HEAD, TAIL

    given = opened.entity(head if head is not None else tail or "", "--tail" if head is None else "ENTITY")
    query = Query(given, opened.relation(relation, "RELATION"), HEAD if head is None else TAIL)
    record = opened.bundle.insertions().get(opened.bundle.entity_names[given])
    answers = answer(opened, query, top, HeldOutCalibration(again(opened, record)) if record else None)
    result = {
        "query": opened.named(query), "answers": list(map(asdict, answers)),
        "calibration": _calibration(answers, inserted=record is not None),
    }  # fmt: skip
    show(result, json, text.ranking)


def nearest(
    entity: Annotated[str, Parameter(help="whose neighbours are listed")], *,
    embedding: Embedding = DEFAULT, top: Top = 10, json: Json = False,
) -> None:  # fmt: skip
    """List the entities of nearest vectors.

    Raises:
        InputError: where the bundle is broken, or the entity is unknown.
    """
    opened = open_folder(embedding)
    row, names, kinds = opened.entity(entity, "ENTITY"), opened.bundle.entity_names, opened.bundle.kinds
    neighbours = [
        {"entity": names[other], "kind": kinds[other] or None, "cosine": cosine}
        for other, cosine in opened.nearest(row, top)
    ]
    show({"entity": names[row], "nearest": neighbours}, json, text.nearest)


def explain(
    entity: Annotated[str, Parameter(help="that isi insert --out has put into this bundle")], *,
    embedding: Embedding = DEFAULT, top: Top = 5, json: Json = False,
) -> None:  # fmt: skip
    """Insert an entity again, and without each insert triple, its words and each indicator.

    Raises:
        InputError: where the bundle is broken, or the entity was not inserted into it.
    """
    import numpy as np
    from tqdm import tqdm

    opened = open_folder(embedding)
    from isi.bundle.explain import ablations, again
    from isi.bundle.folder import MANIFEST
    from isi.bundle.query import queries_of

    row = opened.entity(entity, "ENTITY")
    name, records = opened.bundle.entity_names[row], opened.bundle.insertions()
    if name not in records:
        there = ", ".join(records) or "none"
        raise InputError(embedding, "", f"expected an entity that was inserted ({there}), got {name!r:.80}")
    record = records[name]
    with flags(initializer=f"{embedding / MANIFEST}: inserted: {name}"):
        inserted = again(opened, record)
        shown = inserted.indicators()
        queries = queries_of(opened, row, {one.id: one.weight or 1.0 for one in shown})
        weighted = [one for one in shown if one.weight is not None]
        number = len(record.insert_triples) + len(weighted) + 1
        each = ablations(opened, record, weighted, queries, top)
        without = [asdict(one) for one in tqdm(each, "left out", number, leave=False, disable=None)]
    same = bool(np.allclose(inserted.vector, opened.bundle.entities[row], rtol=1e-3, atol=1e-6))
    indicators = list(map(asdict, shown))
    result = record.model_dump() | {"indicators": indicators, "without": without, "reproduced": same}
    show(result, json, partial(text.explanation, top=top))


def open_folder(path: Path) -> OpenBundle:
    """The bundle of a folder.

    Raises:
        InputError: where there is none, or it is broken.
    """
    if path == DEFAULT and not path.exists():
        here = "not made yet: run `dvc repro train_final`"
        away = f"{Path.cwd()} is not the folder of the project: go there"
        raise InputError(path, "", f"{here if paths.PARAMS.exists() else away}, or name a bundle by --embedding DIR")
    import torch

    from isi.bundle.folder import read
    from isi.bundle.query import open_bundle  # here, since it loads torch

    torch.set_num_threads(1)  # so that equal commands write equal bytes
    return open_bundle(read(path), path)


def refuse_to_lose(folder: Path, names: Collection[str]) -> None:
    """Refuse to replace a bundle that has an inserted entity which the new one lacks.

    Raises:
        InputError: naming these entities.
    """
    from isi.bundle.folder import MANIFEST

    try:
        inserted = [str(record["entity"]) for record in json_format.loads((folder / MANIFEST).read_bytes())["inserted"]]
    except OSError:  # nothing is there
        return
    except (ValueError, LookupError, TypeError, RecursionError) as error:
        expected = "already holds a bundle that cannot be read; choose another folder"
        raise InputError("--out", str(folder), expected) from error
    if lost := [name for name in inserted if name not in names]:
        expected = (
            f"already holds a bundle with {', '.join(lost)}: add to it with --embedding, or choose another folder"
        )
        raise InputError("--out", str(folder), expected)


def _check_new_name(opened: OpenBundle, name: str) -> None:
    from isi.bundle.manifest import name_fault
    from isi.bundle.names import same_name

    if fault := name_fault(name):
        raise InputError("NAME", "", fault)
    if len(name) > LONGEST:
        raise InputError("NAME", "", f"expected at most {LONGEST} characters, got {len(name):,}")
    known = next((known for known in opened.entity_ids if same_name(known, name)), None)
    if known is not None:
        raise InputError("NAME", "", f"expected a new name: {known!r:.80} is known (see isi ask, isi nearest)")


def _check_text(option: str, value: str | None) -> None:
    from isi.bundle.manifest import text_fault

    if value is not None and (fault := text_fault(value)):
        raise InputError(option, "", fault)


def _names(opened: OpenBundle, relation: str, entity: str, option: str) -> Pair:
    """A relation and an entity as they are written in the bundle."""
    bundle = opened.bundle
    return bundle.relation_names[opened.relation(relation, option)], bundle.entity_names[opened.entity(entity, option)]


def _kind(opened: OpenBundle, kind: str | None) -> str:
    from isi.bundle.names import find

    if kind is None:
        return ""
    kinds = list(dict.fromkeys(filter(None, opened.bundle.kinds)))
    return kinds[find(kind, {name: row for row, name in enumerate(kinds)}, "--kind", "a kind of this embedding")]


def _with_words(
    opened: OpenBundle, phrase: str, definition: str | None, vectors: Path | None
) -> tuple[OpenBundle, PhraseVector]:
    from isi.bundle.words import phrase_vector, with_vectors

    if vectors is None:
        return opened, phrase_vector(opened.bundle, phrase, definition)
    bundle, vector = with_vectors(opened.bundle, phrase, vectors)
    return replace(opened, bundle=bundle), vector


def _unusual(opened: OpenBundle, new: NewEntity) -> Iterator[str]:
    """Notes on insert triples whose known end is of a kind that no known triple of the relation has there."""
    from isi.graph.graph import HEAD, TAIL

    kinds = opened.bundle.kinds
    for head, relation, tail in dict.fromkeys(new.insert_triples):
        slot, end, what = (TAIL, tail, "a tail") if head == new.name else (HEAD, head, "a head")
        kind = kinds[opened.entity_ids[end]]
        usual = {kinds[row] for row in opened.in_slot(opened.relation_ids[relation], slot)}
        if kind and usual and not {"", kind} & usual:
            yield f"no known triple of {relation} has {what} of kind {kind}, as {end} is"


def _insertion(inserted: InsertedEntity, words: str, notes: list[str], top: int) -> dict[str, Any]:
    """All that is reported about an insertion."""
    from tqdm import tqdm

    from isi.bundle.answers import answer
    from isi.bundle.calibration import HeldOutCalibration
    from isi.bundle.query import MOST_QUERIES, queries_of

    opened, record, report = inserted.opened, inserted.record, inserted.result.report(top)[0]
    shown, known = inserted.indicators(), len(inserted.result.known_triples) > 0
    weights = {one.id: one.weight or 1.0 for one in shown}
    calibration = HeldOutCalibration(inserted)
    queries = queries_of(opened, inserted.entity, weights)
    answers = [
        (query, answer(opened, query, max(top, EXAMINED), calibration, weights if known else None))
        for query in tqdm(queries, "queries", leave=False, disable=None)
    ]
    vectors = opened.bundle.words
    has_words = vectors is not None and bool(vectors[inserted.entity].any())
    return {
        "entity": record.entity, "id": inserted.entity, "initializer": record.initializer, "why": record.why,
        "fallback": record.fallback, "options": dict(inserted.result.options), "insert_triples": record.insert_triples,
        "words": words if has_words else None, "no_words": None if has_words else words, "notes": notes,
        "indicators": list(map(asdict, shown)),
        "answers": [
            {"query": opened.named(query),
             "answers": [asdict(one) | {"unexpected": is_unexpected(one)} for one in best[:top]]}
            for query, best in answers
        ],
        "all_queries": len(queries) < MOST_QUERIES,
        "calibration": _calibration([one for _, best in answers for one in best], inserted=True),
        "unexpected": _unexpected(opened, answers) if known else None,
        "nearest": [{"entity": name, "cosine": cosine} for name, cosine in report.nearest],
        "distance": report.distance, "farther_than": report.farther_than,
        "interference": asdict(inserted.result.interference()) if known else None,
    }  # fmt: skip


def _unexpected(opened: OpenBundle, answers: Sequence[tuple[Query, list[Answer]]]) -> list[dict[str, Any]]:
    """Unexpected predictions as triples, those of highest probability first."""
    triples = [
        {"triple": opened.named(query, answer.entity), "probability": answer.probability}
        for query, best in answers for answer in best[:EXAMINED] if is_unexpected(answer)
    ]  # fmt: skip
    return sorted(triples, key=lambda one: -(one["probability"] or 0))


def is_unexpected(answer: Answer) -> bool:
    """Whether an answer is likely (without probabilities: the best), not known, and known of no indicator."""
    likely = answer.rank == 1 if answer.probability is None else answer.probability >= LIKELY
    return likely and not answer.known and answer.shared_by == []


def _calibration(answers: Sequence[Answer], inserted: bool) -> str | None:
    """What probabilities are calibrated on; null where an answer has none."""
    if any(answer.probability is None for answer in answers):
        return None
    return "held-out entities" if inserted else "known triples"
