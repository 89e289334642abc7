"""Words that are not ours: WordNet's definitions by synset, GloVe's vectors by word, and the tables that ship."""

from __future__ import annotations

from pathlib import Path

import pandas as pd
import pytest

from isi.errors import InputError
from isi.graph.words import read_vectors
from isi.sources.triples import shipped_names
from isi.tables import paths
from tools import wordnet
from tools.embed_phrases import WORDNET, read

DATA = (
    "  1 A licence, on lines that begin with two spaces.\n"
    "00000051 06 n 01 mug 0 000 | a face\n"
    '00000087 06 n 02 mug 1 cup 0 000 | with a handle; holds tea; "he drank a mug"; "of milk"  \n'
)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """WordNet's files for nouns: ``mug`` of two senses, the second of which is the only one of ``cup``."""
    offsets = [DATA.index(start) for start in ("00000051", "00000087")]
    (tmp_path / "data.noun").write_text(DATA, encoding="latin-1")
    (tmp_path / "index.noun").write_text(
        f"  1 A licence.\ncup n 1 0 1 0 {offsets[1]:08d}  \nmug n 2 1 @ 2 1 {offsets[0]:08d} {offsets[1]:08d}  \n",
        encoding="latin-1",
    )
    return tmp_path


@pytest.mark.parametrize(
    ("synset", "expected"),
    [("mug.n.01", "a face"), ("mug.n.02", "with a handle; holds tea"), ("cup.n.01", "with a handle; holds tea")],
)
def test_a_definition_is_the_gloss_of_a_sense_without_its_examples(folder: Path, synset: str, expected: str) -> None:
    assert wordnet.definition(folder, synset) == expected


@pytest.mark.parametrize("synset", ["mug.n.03", "mug.n.00", "jug.n.01", "mug", "mug.x.01", "mug.n.1"])
def test_a_sense_that_wordnet_lacks_is_refused(folder: Path, synset: str) -> None:
    with pytest.raises(InputError, match=rf"wordnet\.csv: synset '{synset}'"):
        wordnet.definition(folder, synset)


# What ships


def test_every_phrase_is_there_once_in_order_and_defined_where_it_has_a_synset() -> None:
    table = pd.read_csv(WORDNET, keep_default_na=False, dtype=str)
    assert table["phrase"].is_monotonic_increasing
    assert table["phrase"].is_unique
    assert ((table["definition"] != "") == (table["synset"] != "")).all()


def test_the_graphs_that_ship_have_all_their_phrases_in_it() -> None:
    listed = set(read(WORDNET)["phrase"])
    published = pd.read_csv(paths.PUBLISHED_PHRASES)
    assert {*shipped_names()["phrase"], *published["phrase"]} <= listed


def test_every_phrase_of_wordnet_has_a_vector_of_unit_length() -> None:
    words = read_vectors(paths.shipped_vectors("wordnet"))
    assert words.index_to_key == list(read(WORDNET).index)
    assert (abs((words.vectors**2).sum(1) - 1) < 1e-5).all()
