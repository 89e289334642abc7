"""Training of the embedding of a home: of triples by name, of a file, or of what a home knows.

By one recipe (``isi.training.recipe``): its model is measured on test triples
(``isi.training.held_out``), then all triples are trained on.
"""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from isi.columns import COUNT, TRIPLE
from isi.config import Count, Positive, Seed, check
from isi.errors import InputError, at
from isi.graph.files import read_graph
from isi.graph.graph import (
    GraphTables,
    MinedSource,
    build_graph,
    build_tables,
)
from isi.home.bundle import Bundle, Manifest
from isi.home.calibration import calibrated
from isi.home.facts import StoredFact
from isi.home.loaded import LoadedEmbedding
from isi.home.phrases import OF_MODEL, by_model, has_model, with_words
from isi.insertion.arguments import (
    TripleForms,
    column_names,
    named_triples,
    naming_argument,
    of_arrow,
    options_by_name,
)
from isi.models.stack import usual_torch
from isi.sources.names import ENTITY, Label, Naming
from isi.sources.readers import check_names, cleaned
from isi.sources.triples import naming
from isi.tables.rules import MOST_OBSERVED
from isi.training.recipe import MODEL_NAME, Trained, TrainingSummary, train_graph
from isi.vocabulary import Vocabulary, by_known_name, note_of_kinds


def tables_of(triples: TripleForms) -> GraphTables:
    """The graph of triples of names
    (forms: ``named_triples``; a table may have a column ``count``).

    InputError for a wrong triple, name or count.
    """
    with naming_argument("triples"):
        table: Any = of_arrow(triples)
        frame = pd.DataFrame(named_triples(table), columns=list(TRIPLE))
        frame.index.name = "triple"
        check_names(frame, "")
        frame = cleaned(frame)
        counted: Any = next(
            (name for name in column_names(table) if str(name).casefold() == COUNT), None
        )
        counts = np.asarray(table[counted]).tolist() if counted else [1] * len(frame)
        frame[COUNT] = check(counts, list[Count], COUNT, "")
        if not 0 < sum(counts) <= MOST_OBSERVED:
            raise InputError(
                "", "", f"expected 1 to {MOST_OBSERVED:,} observations, got {sum(counts):,}"
            )
        return build_tables(MinedSource("triples", frame, Naming()(frame, ())))


def described(tables: GraphTables, path: Path) -> tuple[GraphTables, str]:
    """``with_kinds`` of a table of entities (``naming``)."""
    named = naming(str(path), None, household=False)
    with at(path):
        return with_kinds(tables, named.kind_of, named.phrase_of)


def with_kinds(
    tables: GraphTables, kinds: Mapping[str, str], phrases: Mapping[str, str] | None = None
) -> tuple[GraphTables, str]:
    """The graph with kinds and phrases by entity (``by_known_name``),
    and a note of names that have no match.

    All other kinds and phrases stay. InputError if no name matches.
    """
    entities, texts = tables.entities, {**kinds, **(phrases or {})}
    names = entities["entity"].tolist()
    known = Vocabulary("entity", names)
    new_kinds, _ = by_known_name(kinds, known)
    new_phrases, _ = by_known_name(phrases or {}, known)
    matched, missing = by_known_name(texts, known)
    if not matched:
        got = note_of_kinds(missing, len(texts), [], known) or "none"
        raise InputError(
            "", "", f"expected the kind or the phrase of an entity of the graph, got {got}"
        )
    kind = [new_kinds.get(name, old) for name, old in zip(names, entities["kind"], strict=True)]
    phrase = [
        new_phrases.get(name, old) for name, old in zip(names, entities["phrase"], strict=True)
    ]
    without = [name for name, new in zip(names, kind, strict=True) if new == ENTITY and kinds]
    note = note_of_kinds(missing, len(texts), without, known)
    return replace(tables, entities=entities.assign(kind=kind, phrase=phrase)), note


def tables_of_file(file: str | Path) -> GraphTables:
    """The graph of a file. Warns, in the name of a caller's caller, of what its reader counts."""
    tables, read = read_graph([file])
    for path, counted in read.items():
        for label, number in counted.items():
            if label != "reader":
                warnings.warn(f"{path}: {label}: {number:,}", stacklevel=3)
    return tables


def with_kinds_of_call(tables: GraphTables, kinds: Mapping[str, str]) -> GraphTables:
    """``with_kinds`` that warns, in the name of a caller's caller, of names without a match."""
    with naming_argument("kinds"):
        named = check(options_by_name(kinds, "kinds"), dict[str, Label], "", "")
        tables, note = with_kinds(tables, named)
    if note:
        warnings.warn(f"kinds: {note}", stacklevel=3)
    return tables


def tables_of_home(rows: Sequence[StoredFact], now: LoadedEmbedding) -> GraphTables:
    """The graph of the facts that hold in a home, with their counts, kinds and phrases; ``now``:
    its embedding.
    """
    facts = [(*row.fact, row.count) for row in rows]
    frame = pd.DataFrame(facts, columns=[*TRIPLE, COUNT])
    tables = build_tables(MinedSource("home", frame, Naming()(frame, ())))
    kinds = dict(zip(now.entity_names, now.kinds, strict=True))
    phrases = dict(zip(now.entity_names, now.phrases, strict=True))
    known_kinds = {name: kind for name, kind in kinds.items() if kind}
    return with_kinds(tables, known_kinds, phrases)[0]


@usual_torch()
def train_bundle(
    tables: GraphTables,
    vectors: str | Path | None = None,
    *,
    learning_rate: float | None = None,
    dimension: int = 100,
    seed: int = 0,
) -> tuple[Bundle, TrainingSummary]:
    """Train an embedding of a graph. Equal arguments give equal bytes
    (with an equal number of PyTorch's threads).

    Args:
        tables: the graph (``build_tables``, ``read_graph``, ``tables_of``).
        vectors: a word2vec or GloVe file, for the word vectors of names.
        learning_rate: of Adagrad; None: the better one of ``RATES`` for validation triples.
        dimension: d, the length of an entity's vector; even.
        seed: root seed of splits, initial vectors, batches and negatives.

    Raises:
        InputError: names the wrong argument, or says that training diverged.
    """
    learning_rate = check(learning_rate, Positive | None, "", "argument 'learning_rate'")  # type: ignore[arg-type]
    seed = check(seed, Seed, "", "argument 'seed'")
    dimension = check(dimension, Count, "", "argument 'dimension'")
    trained = train_graph(
        build_graph(tables.entities, tables.triples), learning_rate, dimension, seed
    )
    file = None if vectors is None else Path(vectors).expanduser()
    return calibrated(with_words(bundle_of(tables, trained), file), trained), trained.summary


def bundle_of(tables: GraphTables, trained: Trained) -> Bundle:
    """The bundle of a graph's embedding."""
    graph, theta = trained.graph, trained.theta
    kinds = ["" if kind == ENTITY else kind for kind in tables.entities["kind"].astype(str)]
    phrases = list(tables.entities["phrase"].astype(str))
    # without the sentence model, a home takes the words of its vocabulary
    words, source = None, None
    if has_model():
        words, source = np.stack(list(map(by_model, phrases))), OF_MODEL
    manifest = Manifest(
        model_name=MODEL_NAME,
        model_options={},
        words=source,
        trained_with="softmax",
        made={"seed": trained.seed, **asdict(trained.summary)},
    )
    return Bundle(
        manifest,
        theta.entity[0].numpy(),
        theta.relation[0].numpy(),
        graph.entities,
        kinds,
        phrases,
        graph.relations,
        graph.triples.numpy(),
        words,
        graph.counts.numpy(),
    )
