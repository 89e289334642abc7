"""Look up the word vector of every entity."""

from __future__ import annotations

import torch

from isi import paths, tables, words
from isi.stage import Params, Provenance, stage


@stage("words.source", "words.text", "words.sha256", argument="experiment")
def embed_words(params: Params, provenance: Provenance, experiment: str) -> None:
    """Look up the word vector of every entity."""
    shipped = params.words.source == "shipped"
    source = str(paths.shipped_vectors(params.words.text)) if shipped else params.words.source
    entities = tables.read(paths.entities(experiment), tables.ENTITIES, provenance)
    found = words.look_up(
        words.load_vectors(source, None if shipped else params.words.sha256), list(entities["phrase"])
    )
    coverage = entities[["entity", "phrase"]].assign(served_by=found.served_by)
    tables.write_tensors(paths.vectors(experiment), {"vectors": torch.from_numpy(found.vectors)}, provenance)
    tables.write(paths.coverage(experiment), coverage, tables.COVERAGE, provenance)
    missing = coverage.loc[coverage["served_by"].isna(), "entity"]
    print(
        f"{len(coverage) - len(missing)} of {len(coverage)} entities have a word vector", *missing, sep="\n  without: "
    )


if __name__ == "__main__":
    embed_words()
