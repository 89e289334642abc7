"""Commands about entities of a bundle: ``isi insert``, ``isi ask``, ``isi nearest``, ``isi explain``.

A command imports its modules when it runs, so that ``--help`` does not wait for PyTorch. An ``InputError`` refuses a
broken bundle or an unknown name.
"""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Parameter

from isi.cli import DEFAULT, FROM_ZERO, Embedding, Json, Out, Settings, Top, flags, settings, show
from isi.config import check
from isi.errors import InputError
from isi.tables import paths

if TYPE_CHECKING:
    from isi.bundle.query import OpenBundle
    from isi.insertion.result import Inserted

EXAMINED = 20  #: Best answers per query that are searched for unexpected ones.
Pair = tuple[str, str]


def insert(
    name: str, *,
    fact: Annotated[tuple[Pair, ...], Parameter(help="RELATION ENTITY: insert triple (NAME, RELATION, ENTITY)")] = (),
    inverse_fact: Annotated[
        tuple[Pair, ...], Parameter(help="ENTITY RELATION: insert triple (ENTITY, RELATION, NAME)")
    ] = (),
    definition: Annotated[str | None, Parameter(help="definition in a sentence, for the word vector")] = None,
    kind: Annotated[str | None, Parameter(help="one of the bundle's kinds; for queries and initializers")] = None,
    initializer: Annotated[str | None, Parameter(help="default: the best for hidden known entities")] = None,
    set: Annotated[Settings, Parameter(help="KEY=VALUE: an option of --initializer")] = (),
    vectors: Annotated[Path | None, Parameter(help="word2vec or GloVe file, for the vectors of all phrases")] = None,
    calibrate: Annotated[bool, Parameter(help="compare initializers on hidden known entities")] = True,
    tolerance: Annotated[float, Parameter(help="largest loss of the MRR of earlier triples in the comparison")] = 0.02,
    budget: Annotated[float, Parameter(help="seconds for the comparison, by an estimate of its work")] = 3,
    seed: Annotated[int, Parameter(validator=FROM_ZERO, help="seed of hidden entities and random initializers")] = 0,
    out: Out = None, embedding: Embedding = DEFAULT, top: Top = 5, json: Json = False,
) -> None:  # fmt: skip
    """Insert an entity and report what the bundle predicts about it."""
    import warnings

    from pydantic import Field

    from isi.bundle.folder import InsertionRequest, Text, write
    from isi.bundle.insert import NewEntity, insert_entity, phrase_vector, with_vectors
    from isi.bundle.query import find, plain, same_name

    opened = open_folder(embedding)
    check(name, Annotated[Text, Field(max_length=200, pattern=r"\S")], "", "NAME")  # type: ignore[arg-type]
    check(definition, Text | None, "", "--definition")  # type: ignore[arg-type]
    check(str(vectors), Text, "", "--vectors")
    if same := [entity for entity in opened.entity_names if same_name(entity, name)]:
        raise InputError("NAME", "", f"expected a new name: {same[0]!r:.80} is known (see isi ask, isi nearest)")

    def known(option: str, relation: str, entity: str) -> tuple[str, str]:
        label = find(relation, opened.relation_ids, option, "a relation")
        return label, find(entity, opened.entity_ids, option, "an entity")

    triples = [(name, *known("--fact", relation, entity)) for relation, entity in fact]
    for entity, relation in inverse_fact:
        label, head = known("--inverse-fact", relation, entity)
        triples.append((head, label, name))
    if set and initializer is None:
        raise InputError("--set", "", "expected an --initializer: --set gives its options")
    if kind is not None:
        kind = find(kind, dict.fromkeys(filter(None, opened.kinds)), "--kind", "a kind")
    if vectors is None:
        vector, note = phrase_vector(opened, plain(name), definition)
    else:
        opened, vector, note = with_vectors(opened, plain(name), vectors)
    if not triples and vector is None and initializer is None:
        expected = f"expected a --fact, an --inverse-fact or a word vector; no word vector: {note}"
        raise InputError(repr(name), "", expected)
    request = InsertionRequest(
        entity=name, insert_triples=triples, definition=definition, requested_initializer=initializer,
        options=settings(set), seed=seed,
    )  # fmt: skip
    named = {name: f"--{name}" for name in ("initializer", "tolerance", "budget")}
    with flags(**named, entities="--embedding"), warnings.catch_warnings(action="ignore", category=UserWarning):
        larger, result = insert_entity(
            opened, NewEntity(request, kind or "", plain(name), vector), calibrate=calibrate, tolerance=tolerance,
            budget=budget,
        )  # fmt: skip
    notes = [*opened.kind_notes(triples), *(result.choice.warnings if result.choice else ())]
    answer = insertion(larger, result, note, notes, top)
    if out:
        write(out, larger)
    show(answer, json)
    if out and not json:
        print(f"written: {out}")


def insertion(opened: OpenBundle, result: Inserted, words: str, notes: list[str], top: int) -> dict[str, Any]:
    """Answer of ``isi insert``: report of the last entity. ``words``: source of its word vector, or why it has none."""
    from tqdm import tqdm

    from isi.bundle.calibration import HeldOutCalibration, answer, calibrated_on
    from isi.bundle.insert import indicators
    from isi.bundle.query import MOST_QUERIES, queries_of
    from isi.graph.graph import HEAD, TAIL

    (report,), inserted, known = result.report(top), opened.manifest.inserted, len(result.known_triples) > 0
    record, later_end = inserted[-1], result.known_triples[:, [HEAD, TAIL]].max(1)
    old = {number: len(opened.entities) - number for number in (1, len(inserted))}  # before this; before the first
    harm = {number: result.interference(original=old[number], show=top)
            for number in old if (later_end < old[number]).any()}  # fmt: skip
    shown = indicators(opened, result)
    weights = {indicator.id: indicator.weight or 1.0 for indicator in shown}
    calibration, queries = HeldOutCalibration(opened, result), queries_of(opened, report.id, weights)
    answers = {
        opened.named(query): answer(opened, query, max(top, EXAMINED), calibration, weights if known else None)
        for query in tqdm(queries, "queries", leave=False, disable=None)
    }
    unexpected = [
        {"triple": tuple(best.entity if part == "?" else part for part in query), "probability": best.probability}
        for query, ranked in answers.items() for best in ranked[:EXAMINED] if best.unexpected
    ]  # fmt: skip
    has_words = opened.words is not None and bool(opened.words[report.id].any())
    return {
        "entity": record.entity, "id": report.id, "initializer": record.initializer, "why": record.why,
        "fallback": record.fallback, "options": dict(result.options),
        "expected": result.choice and result.choice.expected, "insert_triples": record.insert_triples,
        "words": words if has_words else None, "no_words": None if has_words else words, "notes": notes,
        "indicators": list(map(asdict, shown)),
        "answers": [
            {"query": query, "answers": [asdict(best) | {"unexpected": best.unexpected} for best in ranked[:top]]}
            for query, ranked in answers.items()
        ],
        "all_queries": len(queries) < MOST_QUERIES,
        "calibration": calibrated_on([best for ranked in answers.values() for best in ranked], inserted=True),
        "unexpected": sorted(unexpected, key=lambda triple: -(triple["probability"] or 0)) if known else None,
        "nearest": [{"entity": name, "cosine": cosine} for name, cosine in report.nearest],
        "distance": report.distance, "farther_than": report.farther_than,
        "interference": [
            {"insertions": number, "queries": of.queries, "h_old": of.h_old, "h_cur": of.h_cur,
             "rank_old": of.rank_old, "rank_cur": of.rank_cur}
            for number, of in harm.items()
        ] if known else None,
        "changes": list(map(asdict, harm[1].changes)) if known else None,
    }  # fmt: skip


def ask(
    head: Annotated[str | None, Parameter(help="head of the query; the answers are tails")] = None,
    relation: Annotated[str | None, Parameter(help="relation of the query")] = None, *,
    tail: Annotated[str | None, Parameter(help="tail of the query; the answers are heads")] = None,
    embedding: Embedding = DEFAULT, top: Top = 10, json: Json = False,
) -> None:  # fmt: skip
    """Rank the answers of one query."""
    from isi.bundle.calibration import HeldOutCalibration, answer, calibrated_on
    from isi.bundle.insert import before, insert_entity
    from isi.bundle.query import Query, find
    from isi.graph.graph import HEAD, TAIL

    if relation is None or (head is None) == (tail is None):
        raise InputError("", "", "expected ENTITY RELATION, or --relation RELATION --tail ENTITY")
    opened, place, slot = open_folder(embedding), "ENTITY" if tail is None else "--tail", TAIL if tail is None else HEAD
    name = find(head or tail or "", opened.entity_ids, place, "an entity")
    label = find(relation, opened.relation_ids, "RELATION", "a relation")
    query, record = Query(opened.entity_ids[name], opened.relation_ids[label], slot), opened.insertions().get(name)
    calibration = HeldOutCalibration(*insert_entity(*before(opened, record))) if record else None
    answers = answer(opened, query, top, calibration)
    calibrated = calibrated_on(answers, inserted=record is not None)
    show({"query": opened.named(query), "answers": list(map(asdict, answers)), "calibration": calibrated}, json)


def nearest(
    entity: Annotated[str, Parameter(help="entity whose nearest neighbours are listed")], *,
    embedding: Embedding = DEFAULT, top: Top = 10, json: Json = False,
) -> None:  # fmt: skip
    """List the other entities by the cosine of their vectors with the entity's."""
    from isi.bundle.query import find

    opened = open_folder(embedding)
    name, names, kinds = find(entity, opened.entity_ids, "ENTITY", "an entity"), opened.entity_names, opened.kinds
    neighbours = [
        {"entity": names[row], "kind": kinds[row] or None, "cosine": cosine}
        for row, cosine in opened.nearest(opened.entity_ids[name], top)
    ]
    show({"entity": name, "nearest": neighbours}, json)


def explain(
    entity: Annotated[str, Parameter(help="an entity that isi insert --out has added to the bundle")], *,
    embedding: Embedding = DEFAULT, top: Top = 5, json: Json = False,
) -> None:  # fmt: skip
    """Repeat an insertion, then repeat it without each insert triple, without the words, without each indicator."""
    import numpy as np
    from tqdm import tqdm

    from isi.bundle.folder import MANIFEST
    from isi.bundle.insert import ablations, before, indicators, insert_entity
    from isi.bundle.query import find, queries_of

    opened = open_folder(embedding)
    name, records = find(entity, opened.entity_ids, "ENTITY", "an entity"), opened.insertions()
    if name not in records:
        there = ", ".join(records) or "none"
        raise InputError(embedding, "", f"expected an entity that was inserted ({there}), got {name!r:.80}")
    record, row = records[name], opened.entity_ids[name]
    with flags(initializer=f"{embedding / MANIFEST}: inserted: {name}"):
        larger, result = insert_entity(*before(opened, record))
        shown = indicators(larger, result)
        queries = queries_of(opened, row, {indicator.id: indicator.weight or 1.0 for indicator in shown})
        weighted = [indicator for indicator in shown if indicator.weight is not None]
        each = ablations(opened, record, weighted, queries, top)
        number = len(record.insert_triples) + len(weighted) + 1
        without = [asdict(ablation) for ablation in tqdm(each, "left out", number, leave=False, disable=None)]
    same = bool(np.allclose(result.entities[-1], opened.entities[row], rtol=1e-3, atol=1e-6))
    answer = {"indicators": list(map(asdict, shown)), "without": without, "reproduced": same}
    show(record.model_dump() | answer, json)


def open_folder(path: Path) -> OpenBundle:
    """Open the bundle of a folder. An ``InputError`` refuses a missing or broken one."""
    import torch

    from isi.bundle.query import open_bundle

    if path == DEFAULT and not path.exists():
        here = "not trained yet: run `dvc repro train_final`"
        away = f"no such folder in {Path.cwd()}: run this in the folder of the project"
        raise InputError(path, "", f"{here if paths.PARAMS.exists() else away}, or name a bundle by --embedding DIR")
    torch.set_num_threads(1)  # so that equal commands write equal bytes
    return open_bundle(path)
