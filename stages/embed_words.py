"""Look up the word vector of each entity's phrase."""

import torch

from isi.errors import at
from isi.graph.graph import ENTITIES
from isi.graph.words import COVERAGE, WORD_VECTORS, load_vectors, look_up
from isi.tables import paths
from stages.stage import StageContext, stage


@stage
def embed_words(context: StageContext, experiment: str) -> None:
    entities = ENTITIES.read(experiment=experiment)
    with at(paths.PARAMS, "words"):
        words = look_up(load_vectors(context.params.words), list(entities["phrase"]))
    coverage = entities[["entity", "phrase"]].assign(served_by=words.served_by)
    WORD_VECTORS.write(
        {"vectors": torch.from_numpy(words.vectors)}, context.stage, experiment=experiment
    )
    COVERAGE.write(coverage, context.stage, experiment=experiment)
    missing = coverage.loc[coverage["served_by"].isna(), "entity"]
    covered = f"{len(coverage) - len(missing)} of {len(coverage)} entities have a word vector"
    print(covered, *missing, sep="\n  without: ")


if __name__ == "__main__":
    embed_words()
