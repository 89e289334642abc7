"""Look up the word vector of each entity's phrase."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Literal

import pandas as pd
import torch

from isi.config import Section, Sha256
from isi.errors import InputError, at, short
from isi.graph.words import look_up, read_vectors
from isi.tables import paths
from isi.tables.io import check_sha256
from isi.tables.rules import TEXT, ColumnType
from isi.tables.table import Table
from stages.files import ENTITIES, WORD_VECTORS
from stages.stage import StageContext, stage

if TYPE_CHECKING:
    from gensim.models import KeyedVectors

#: The phrase of each entity, and the tokens whose vectors it has (``WordVectors.served_by``).
COVERAGE = Table(
    "data/words/{experiment}/coverage.parquet",
    key=["entity"],
    columns={"entity": TEXT, "phrase": TEXT, "served_by": ColumnType(TEXT.type, nullable=True)},
)


class Words(Section):
    """``words`` in params: which word vectors to use."""

    source: str
    text: Literal["definition", "phrase", "wordnet", "glove"]
    sha256: Sha256 | None

    @property
    def shipped(self) -> bool:
        """Whether these are the vectors under ``data/raw``."""
        return self.source == "shipped"


@stage
def embed_words(context: StageContext, experiment: str) -> None:
    settings: Words = context.params.read("words", Words)
    entities = ENTITIES.read(experiment=experiment)
    with at(paths.PARAMS, "words"):
        words = look_up(load_vectors(settings), list(entities["phrase"]))
    served_by = pd.Series(words.served_by)
    coverage = entities[["entity", "phrase"]].assign(served_by=served_by)
    WORD_VECTORS.write(
        {"vectors": torch.from_numpy(words.vectors)}, context.stage, experiment=experiment
    )
    COVERAGE.write(coverage, context.stage, experiment=experiment)
    missing = coverage.loc[coverage["served_by"].isna(), "entity"]
    covered = f"{len(coverage) - len(missing)} of {len(coverage)} entities have a word vector"
    print(covered, *missing, sep="\n  without: ")


def load_vectors(words: Words) -> KeyedVectors:
    """Load the word vectors that params name: shipped, or from a file."""
    if words.shipped:
        return read_vectors(paths.shipped_vectors(words.text))
    path = Path(words.source)
    with at(short(words.source)):
        is_file = path.is_file()
    if not is_file:
        raise InputError(path, "", "expected a file of word vectors, but there is no such file")
    check_sha256(path, words.sha256)
    return read_vectors(path)


if __name__ == "__main__":
    embed_words()
