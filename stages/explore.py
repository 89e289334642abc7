"""An experiment on a graph of its own, from its source to what its models answer."""

from __future__ import annotations

import pandas as pd
import pyarrow as pa

from isi import building
from isi.base import paths, tables
from isi.base.errors import InputError
from isi.base.stage import Given, stage
from isi.building import GraphTables, Seen
from isi.graph import build
from isi.sessions.drawing import Shares
from isi.sessions.listing import listed
from isi.sources import observing
from isi.studies.elsewhere import Elsewhere, Held
from isi.studies.variants import changed, results
from isi.words import load_vectors, look_up


@stage
def explore(given: Given, graph: str) -> None:
    """Run an experiment on a graph of its own: mine, draw sessions, train, insert, and fine-tune until convergence."""
    key, provenance = f"graphs.{graph}", given.provenance
    how = given.section(key, Elsewhere)
    try:
        found = building.graph_of(seen_by(graph, how, given.seed, f"{key}.source"), how.min_count)
        if found.triples.empty:
            raise InputError(f"{key}.source", "", f"expected triples that are observed {how.min_count} times")
        store = held(given, graph, found, how, key)
    except InputError as error:
        raise InputError(paths.BEYOND_PARAMS, key, str(error)) from error
    study = how.variant(graph)
    runs, asked = results(changed(given, how.changes, f"{key}.changes"), study, [store], graph)
    tables.write(paths.explored(graph, "entities"), found.entities, tables.ENTITIES, provenance)
    tables.write(paths.explored(graph, "triples"), found.triples, tables.TRIPLES, provenance)
    tables.write(paths.explored(graph, "runs"), runs, tables.VARIANTS, provenance)
    tables.write(paths.explored(graph, "asked"), asked, tables.VARIANTS_ASKED, provenance)


def seen_by(graph: str, how: Elsewhere, root: int, key: str) -> Seen:
    """What the source observes."""
    observed, passing = observing(how.source, key, root)
    parts = pa.concat_tables([tables.OBSERVATIONS.columns.empty_table(), *passing]).unify_dictionaries()
    frame: pd.DataFrame = parts.to_pandas()
    for step, instances in observed.mining.left.items():
        print(f"{instances:,} {step}")
    return Seen(graph, frame, observed.kinds)


def held(given: Given, graph: str, found: GraphTables, how: Elsewhere, key: str) -> Held:
    """The graph with its word vectors and its sessions."""
    words = look_up(load_vectors(how.words), list(found.entities["phrase"]))
    shares, of_ids = given.section("sessions", Shares), build(found.entities, found.triples)
    drawn = listed(of_ids, found.entities, how.sessions, shares, given.seed, f"{key}.sessions")
    size, missing = found.triples["count"].sum(), words.served_by.count(None)
    print(f"{len(found.entities)} entities, {len(found.triples):,} unique triples of {size:,} observations")
    print(f"{len(found.entities) - missing} of {len(found.entities)} entities have a word vector")
    return Held(graph, given.provenance, found, words.vectors, drawn)


if __name__ == "__main__":
    explore()
