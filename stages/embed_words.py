"""Look up the word vector of every entity."""

from __future__ import annotations

import torch

from isi.errors import InputError
from isi.graph.tables import COVERAGE, ENTITIES, WORD_VECTORS
from isi.graph.words import Words, load_vectors, look_up
from isi.stage import StageContext, stage


@stage
def embed_words(given: StageContext, experiment: str) -> None:
    """Look up the word vector of every entity."""
    which = given.section("words", Words)
    entities = ENTITIES.read(experiment=experiment)
    try:
        found = look_up(load_vectors(which), list(entities["phrase"]))
    except InputError as error:
        raise InputError("words", "", str(error)) from error
    coverage = entities[["entity", "phrase"]].assign(served_by=found.served_by)
    WORD_VECTORS.write({"vectors": torch.from_numpy(found.vectors)}, given.stage, experiment=experiment)
    COVERAGE.write(coverage, given.stage, experiment=experiment)
    missing = coverage.loc[coverage["served_by"].isna(), "entity"]
    print(
        f"{len(coverage) - len(missing)} of {len(coverage)} entities have a word vector", *missing, sep="\n  without: "
    )


if __name__ == "__main__":
    embed_words()
