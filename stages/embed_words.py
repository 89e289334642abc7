"""Look up the word vector of every entity."""

from __future__ import annotations

import torch

from isi.base import paths, tables
from isi.base.errors import InputError
from isi.base.stage import Given, stage
from isi.words import Words, load_vectors, look_up


@stage
def embed_words(given: Given, experiment: str) -> None:
    """Look up the word vector of every entity."""
    which, provenance = given.section("words", Words), given.provenance
    entities = tables.read(paths.entities(experiment), tables.ENTITIES, provenance)
    try:
        found = look_up(load_vectors(which), list(entities["phrase"]))
    except InputError as error:
        raise InputError("words", "", str(error)) from error
    coverage = entities[["entity", "phrase"]].assign(served_by=found.served_by)
    tables.write_tensors(paths.vectors(experiment), {"vectors": torch.from_numpy(found.vectors)}, provenance)
    tables.write(paths.coverage(experiment), coverage, tables.COVERAGE, provenance)
    missing = coverage.loc[coverage["served_by"].isna(), "entity"]
    print(
        f"{len(coverage) - len(missing)} of {len(coverage)} entities have a word vector", *missing, sep="\n  without: "
    )


if __name__ == "__main__":
    embed_words()
