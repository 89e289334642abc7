"""``isi graph``: builds a graph from your own scenes or triples, and describes it."""

from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any

import pandas as pd
from cyclopts import Parameter

from isi import config
from isi.cli import FROM_ONE, Settings, settings, show
from isi.config import Seed, check
from isi.errors import InputError, short, suggestion
from isi.graph.graph import ENTITIES, TRIPLES, GraphTables, MinedSource, build_graph, build_tables
from isi.graph.sessions import TRAIN, Shares, split
from isi.graph.words import Words, load_vectors, look_up
from isi.sources import Source, all_readers
from isi.sources.readers import open_text, parse_json, reading, suffix_of
from isi.tables import paths

LISTED = 8  #: Maximum number of names in a list.
SPLITS = 5  #: Number of random splits; the least of their numbers of triples outside train is reported.
MOST = 2**26  #: Maximum number of JSON characters that are read to guess the reader.
COLUMNS = ["head", "relation", "tail"]


def graph(
    files: Annotated[
        tuple[Path, ...], Parameter(name="FILE", required=True, help="triples (table or RDF), scenes, or houses")
    ] = (), /, *,
    reader: Annotated[str | None, Parameter(help="name of a reader; default: guessed from the file")] = None,
    set: Annotated[Settings, Parameter(help="KEY=VALUE: a setting of the reader, as in params.yaml")] = (),
    min_count: Annotated[int, Parameter(validator=FROM_ONE, help="drop triples with fewer observations")] = 1,
    out: Annotated[Path | None, Parameter(help="folder for entities.parquet and triples.parquet")] = None,
) -> None:  # fmt: skip
    """Read files, describe their graph, and write it. Words, seed and split shares come from ``params.yaml``."""
    values = config.read(paths.PARAMS)
    seed, options = check(values.get("seed"), Seed, "seed"), settings(set)
    readings = [read(file, reader, options, seed) for file in files]
    tables = build_tables(together([seen for *_, seen in readings]), min_count)
    if tables.triples.empty:
        raise InputError(files[0], "", f"expected a triple of count {min_count} (--min-count) or more, got none")
    described = describe(tables, values)
    if out:
        ENTITIES.write_file(out / "entities.parquet", tables.entities, "isi graph")
        TRIPLES.write_file(out / "triples.parquet", tables.triples, "isi graph")
    rows = zip(files, readings, strict=True)
    show({str(file): {"reader": name, **counts} for file, (name, counts, _) in rows} | described)


def read(file: Path, reader: str | None, given: Mapping[str, Any], seed: int) -> tuple[str, Counter[str], MinedSource]:
    """Read a file or folder: the reader's name (guessed if null), its counters, and its observations."""
    known, name = all_readers(), reader or guess(file)
    if name not in known:
        expected = f"expected one of {', '.join(known)}, got {short(name)}{suggestion(name, known)}"
        raise InputError("--reader", "", expected)
    if known[name].path is None:
        raise InputError(f"reader {name}", "", "expected a reader of files: this one reads shipped data")
    slot = str(known[name].path).removesuffix("_")
    for key in {"reader", slot} & set(given):
        raise InputError("--set", key, "expected another setting: FILE or --reader gives this one")
    try:
        source = Source({"reader": name, **known[name].defaults, slot: str(file), **given}, "--set", seed)
    except InputError as error:
        raise (InputError("", *error.args[1:]) if error.file == str(paths.PARAMS) else error) from error
    types = dict.fromkeys(COLUMNS, str) | {"count": "int64"}
    parts = (part.select(list(types)).to_pandas().astype(types) for part in source.tables())
    observed = pd.concat([part.groupby(COLUMNS, sort=False)["count"].sum().reset_index() for part in parts])
    return name, source.counts, MinedSource(file.name, observed, source.kinds)


def together(sources: Sequence[MinedSource]) -> MinedSource:
    """Join the observations of several files. An ``InputError`` refuses an entity of two different kinds."""
    if len(sources) == 1:
        return sources[0]
    kind_of: dict[str, str] = {}
    for seen in sources:
        for name, kind in zip(seen.kinds["entity"], seen.kinds["kind"], strict=True):
            if kind != (first := kind_of.setdefault(name, kind)):
                raise InputError(seen.source, f"entity {name!r}", f"another file has kind {first!r}, got {kind!r}")
    kinds = pd.concat([seen.kinds for seen in sources]).drop_duplicates("entity", ignore_index=True)
    return MinedSource("files", pd.concat([seen.observations for seen in sources]), kinds)


def guess(file: Path) -> str:
    """The first reader that fits a file's suffix or the keys of its JSON; ``InputError`` if none fits."""
    suffix, known = suffix_of(file), all_readers()
    fitting = [name for name, reader in known.items() if suffix in reader.suffixes]
    if not fitting and suffix in (".json", ".jsonl"):
        with reading(file, "UTF-8 text"), open_text(file) as text:
            line = text.readline(MOST)
            try:
                value = parse_json(Any, line, file)  # of JSON Lines, the first
            except InputError:
                value = parse_json(Any, line + text.read(MOST), file)
        fitting = [name for name, reader in known.items() if reader.reads_json(value)]
    if not fitting:
        expected = f"expected a file of a known format; else name its reader with --reader: {', '.join(known)}"
        raise InputError(file, "", expected)
    return fitting[0]


def describe(tables: GraphTables, values: Mapping[str, Any]) -> dict[str, Any]:
    """Describe a graph of at least one triple; ``values`` are params (``seed``, ``words``, ``sessions``)."""
    entities, triples = tables.entities, tables.triples
    served = look_up(load_vectors(check(values.get("words"), Words, "words")), list(entities["phrase"])).served_by
    pairs = triples[["head", "tail"]].astype(str)
    ends = pd.concat([pairs["head"], pairs.loc[pairs["head"] != pairs["tail"], "tail"]]).value_counts()
    shares, root = check(values.get("sessions"), Shares, "sessions"), check(values.get("seed"), Seed, "seed")
    built = build_graph(entities, triples)
    held_out = shares.valid, shares.test
    draws = (split(built, root, seed, *held_out) for seed in range(SPLITS))
    relations = triples.astype({"relation": str}).groupby("relation")["count"].agg(["size", "sum"])
    return {
        "entities": len(entities), "unique_triples": len(triples), "observations": int(triples["count"].sum()),
        "entities_by_kind": dict(Counter(sorted(entities["kind"].astype(str))).most_common()),
        "relations": [
            {"relation": relation, "unique_triples": number, "observations": observations}
            for relation, number, observations in relations.itertuples()
        ],
        "without_a_word_vector": _first_names(entities.loc[pd.isna(pd.Series(served)), "entity"].tolist()),
        "with_one_triple,_which_stays_in_train": _first_names(sorted(ends.index[ends == 1])),
        "triples_observed_once": int((triples["count"] == 1).sum()),
        "triples_for_validation_and_test": sum(max(1, round(share * len(triples))) for share in held_out),
        "triples_that_can_leave_train": min(int((splits != TRAIN).sum()) for splits in draws),
    }  # fmt: skip


def _first_names(names: Sequence[str]) -> str:
    more = [f"and {len(names) - LISTED:,} more"] * (len(names) > LISTED)
    return f"{len(names):,}" + f" ({', '.join([*names[:LISTED], *more])})" * bool(names)
