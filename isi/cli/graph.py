"""``isi graph``: a graph of scenes or triples of your own, and what is in it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Annotated, Any

import pandas as pd
from cyclopts import Parameter

from isi import config
from isi.cli._reading import read, together
from isi.cli.app import FROM_ONE, Settings, settings
from isi.config import Seed, check
from isi.errors import InputError, unwritable
from isi.graph.graph import ENTITIES, TRIPLES, GraphTables, build_tables
from isi.tables import paths

#: Names that are listed, at most.
LISTED = 8
#: How many splits are drawn to see how many triples they can hold out.
SPLITS = 5


def graph(
    files: Annotated[
        tuple[Path, ...], Parameter(name="FILE", required=True, help="triples as table or RDF, a scene, a house")
    ] = (), /, *,
    reader: Annotated[str | None, Parameter(help="what reads them; guessed where a file tells")] = None,
    set: Annotated[Settings, Parameter(help="KEY=VALUE: a setting of the reader, as in params.yaml")] = (),
    min_count: Annotated[int, Parameter(validator=FROM_ONE, help="drop triples that are observed less often")] = 1,
    out: Annotated[Path | None, Parameter(help="folder for entities.parquet and triples.parquet")] = None,
) -> None:  # fmt: skip
    """Read, count, describe, and write.

    Raises:
        InputError: where a file is broken, or ``params.yaml``, whose words and shares of sessions apply.
    """
    values = config.read(paths.PARAMS)
    seed, options = check(values.get("seed"), Seed, "seed"), settings(set)
    readings = [read(file, reader, options, seed) for file in files]
    tables = build_tables(together(readings), min_count)
    if tables.triples.empty:
        raise InputError(files[0], "", f"no triple was observed {min_count} times")
    lines = list(described(tables, values))
    if out:
        _write(out, tables)
    for file, reading in zip(files, readings, strict=True):
        print(f"{file}: read as {reading.reader}")
        print("".join(f"  {number:,} {step}\n" for step, number in reading.counts.items()), end="")
    print(*lines, sep="\n")


def described(graph: GraphTables, values: dict[str, Any]) -> Iterator[str]:
    """What is in a graph, line by line.

    Args:
        graph: of at least one triple.
        values: of ``params.yaml``: its seed, its words and its shares of validation and test.
    """
    entities, triples = graph.entities, graph.triples
    total = triples["count"].sum()
    yield f"{len(entities)} entities, {len(triples):,} unique triples of {total:,} observations"
    yield "entities by kind"
    of_kind = Counter(sorted(entities["kind"].astype(str))).most_common()
    yield from (f"  {number:,} {kind}" for kind, number in of_kind)
    yield "relations"
    for relation, own in triples.groupby(triples["relation"].astype(str)):
        yield f"  {relation}: {len(own):,} unique triples of {own['count'].sum():,} observations"
    yield "words"
    yield f"  {_number_of(_wordless(entities, values), entities)} have no word vector"
    yield "too rare to split"
    yield from (f"  {line}" for line in _rare(graph, values))


def _wordless(entities: pd.DataFrame, values: dict[str, Any]) -> list[str]:
    from isi.graph.words import Words, load_vectors, look_up  # here, since it loads gensim

    found = look_up(load_vectors(check(values.get("words"), Words, "words")), list(entities["phrase"]))
    return [name for name, served in zip(entities["entity"], found.served_by, strict=True) if served is None]


def _rare(graph: GraphTables, values: dict[str, Any]) -> Iterator[str]:
    from isi.graph.graph import build_graph  # here, since it loads torch
    from isi.graph.sampling import Shares, split
    from isi.graph.sessions import TRAIN

    triples = graph.triples
    pairs = triples[["head", "tail"]].astype(str)
    ends = pd.concat([pairs["head"], pairs.loc[pairs["head"] != pairs["tail"], "tail"]]).value_counts()
    once = sorted(ends.index[ends == 1])
    yield f"{_number_of(once, graph.entities)} have one triple: it stays in train, so that nothing is asked of them"
    yield f"{(triples['count'] == 1).sum():,} of {len(triples):,} unique triples were observed once"
    shares, root = check(values.get("sessions"), Shares, "sessions"), check(values.get("seed"), Seed, "seed")
    wanted = sum(max(1, round(share * len(triples))) for share in (shares.valid, shares.test))
    built = build_graph(graph.entities, triples)
    draws = (split(built, root, seed, shares.valid, shares.test) for seed in range(SPLITS))
    free = min(int((splits != TRAIN).sum()) for splits in draws)
    verdict = "which it has" if wanted <= free else f"but only {free:,} can leave train: too few for sessions"
    yield f"validation and test take {wanted:,} triples, {verdict}"


def _number_of(names: Sequence[str], entities: pd.DataFrame) -> str:
    more = [f"and {len(names) - LISTED:,} more"] * (len(names) > LISTED)
    listed = f" ({', '.join([*names[:LISTED], *more])})" if names else ""
    return f"{len(names):,} of {len(entities):,} entities{listed}"


def _write(folder: Path, graph: GraphTables) -> None:
    try:
        ENTITIES.write_file(folder / "entities.parquet", graph.entities, "isi graph")
        TRIPLES.write_file(folder / "triples.parquet", graph.triples, "isi graph")
    except OSError as error:
        raise unwritable(folder, error) from error
