"""Look up the word vector of every entity."""

from __future__ import annotations

import torch

from isi.errors import InputError
from isi.graph.words import Words, load_vectors, look_up
from isi.stage import StageContext, stage
from isi.tables import catalogue, io, paths


@stage
def embed_words(given: StageContext, experiment: str) -> None:
    """Look up the word vector of every entity."""
    which, provenance = given.section("words", Words), given.provenance
    entities = io.read(paths.entities(experiment), catalogue.ENTITIES, provenance)
    try:
        found = look_up(load_vectors(which), list(entities["phrase"]))
    except InputError as error:
        raise InputError("words", "", str(error)) from error
    coverage = entities[["entity", "phrase"]].assign(served_by=found.served_by)
    io.write_tensors(paths.vectors(experiment), {"vectors": torch.from_numpy(found.vectors)}, provenance)
    io.write(paths.coverage(experiment), coverage, catalogue.COVERAGE, provenance)
    missing = coverage.loc[coverage["served_by"].isna(), "entity"]
    print(
        f"{len(coverage) - len(missing)} of {len(coverage)} entities have a word vector", *missing, sep="\n  without: "
    )


if __name__ == "__main__":
    embed_words()
