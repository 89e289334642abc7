"""``isi graph``: builds a graph from your own scenes or triples, and describes it."""

from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any

import pandas as pd
from cyclopts import Parameter

from isi import config
from isi.cli import Settings, lines, settings, show
from isi.cli.output import Replace, paths_in, write_outputs
from isi.config import Seed, check
from isi.graph.files import graph_files, path_of, read_graph
from isi.graph.graph import GraphTables, build_graph
from isi.graph.words import Words, load_vectors, look_up
from isi.tables import paths

LISTED = 8  #: Maximum number of names in a list.
#: Number of random splits; the least of their numbers of triples outside train is reported.
SPLITS = 5


def graph(
    files: Annotated[
        tuple[str, ...],
        Parameter(name="FILE", required=True, help="triples or scenes; ROOM=FILE: in a room"),
    ] = (),
    /,
    *,
    reader: Annotated[
        str | None, Parameter(help="name of a reader; default: by the suffix")
    ] = None,
    set: Annotated[
        Settings, Parameter(help="KEY=VALUE: a setting of the reader, as in params.yaml")
    ] = (),
    out: Annotated[
        Path | None, Parameter(help="folder for triples.csv and entities.csv, which is a FILE")
    ] = None,
    replace: Replace = False,
) -> None:
    """Read files, describe their graph, and write it.
    If there is a ``params.yaml``, its words and splits count.
    """
    values = config.read(paths.PARAMS) if paths.PARAMS.exists() else {}
    seed = check(values.get("seed", 0), Seed, "seed")
    of_reader = settings(set)
    tables, read = read_graph(files, reader, of_reader, seed)
    described = describe(tables, values)
    contents = {out / name: content for name, content in graph_files(tables).items()} if out else {}
    write_outputs(contents, [*map(path_of, files), *paths_in(of_reader)], replace)
    print(*lines(read, are_names=True), sep="\n")
    show(described)
    if out:
        print(f"written: {', '.join(map(str, contents))}")


def describe(tables: GraphTables, values: Mapping[str, Any]) -> dict[str, Any]:
    """Describe a graph of at least one triple;
    params (``seed``, ``words``, ``sessions``) add words and splits.
    """
    entities, triples = tables.entities, tables.triples
    words, splits = dict[str, Any](), dict[str, Any]()
    if "words" in values:
        served = look_up(
            load_vectors(check(values["words"], Words, "words")), list(entities["phrase"])
        ).served_by
        without = entities.loc[pd.isna(pd.Series(served)), "entity"]
        words = {"without_a_word_vector": _first_names(without.tolist())}
    if "sessions" in values:
        from isi.graph.sessions import TRAIN, Shares, split  # here, since it loads torch

        shares = check(values["sessions"], Shares, "sessions")
        root = check(values.get("seed"), Seed, "seed")
        built, held_out = build_graph(entities, triples), (shares.valid, shares.test)
        leaving = [
            int((split(built, root, seed, *held_out) != TRAIN).sum()) for seed in range(SPLITS)
        ]
        number = sum(max(1, round(share * len(triples))) for share in held_out)
        splits = {
            "triples_for_validation_and_test": number,
            "triples_that_can_leave_train": min(leaving),
        }
    pairs = triples[["head", "tail"]].astype(str)
    ends = pd.concat(
        [pairs["head"], pairs.loc[pairs["head"] != pairs["tail"], "tail"]]
    ).value_counts()
    relations = triples.astype({"relation": str}).groupby("relation")["count"].agg(["size", "sum"])
    return {
        "entities": len(entities),
        "unique_triples": len(triples),
        "observations": int(triples["count"].sum()),
        "entities_by_kind": dict(Counter(sorted(entities["kind"].astype(str))).most_common()),
        "relations": [
            {"relation": relation, "unique_triples": number, "observations": observations}
            for relation, number, observations in relations.itertuples()
        ],
        **words,
        "with_one_triple,_which_stays_in_train": _first_names(sorted(ends.index[ends == 1])),
        "triples_observed_once": int((triples["count"] == 1).sum()),
        **splits,
    }


def _first_names(names: Sequence[str]) -> str:
    more = [f"and {len(names) - LISTED:,} more"] * (len(names) > LISTED)
    return f"{len(names):,}" + f" ({', '.join([*names[:LISTED], *more])})" * bool(names)
