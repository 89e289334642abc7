"""Word vectors: every file format, every way to look a phrase up, and broken files."""

import gzip
import json
import struct
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from gensim.models import KeyedVectors

from isi.errors import InputError
from isi.graph import words
from isi.sources.names import entity_name
from isi.sources.recordings import locate
from isi.sources.triples import published_phrases
from stages.embed_words import Words, load_vectors
from stages.files import DEFINITIONS
from tools.embed_phrases import reuse

VECTORS = {
    "alarm": [1.0, 0.0, 0.0],
    "clock": [0.0, 1.0, -2.5],
    "house_plant": [0.5, 0.25, 8.0],
    "plant": [-1.0, 3.0, 1e-7],
    "café": [0.0, 0.0, 2.0],
}


def glove(vectors: dict[str, list[float]] = VECTORS) -> bytes:
    return "".join(
        f"{token} {' '.join(map(repr, vector))}\n" for token, vector in vectors.items()
    ).encode()


def text(vectors: dict[str, list[float]] = VECTORS) -> bytes:
    return f"{len(vectors)} {len(next(iter(vectors.values())))}\n".encode() + glove(vectors)


def binary(vectors: dict[str, list[float]] = VECTORS, newline: bytes = b"\n") -> bytes:
    rows = [
        token.encode() + b" " + struct.pack(f"<{len(v)}f", *v) + newline
        for token, v in vectors.items()
    ]
    return f"{len(vectors)} {len(next(iter(vectors.values())))}\n".encode() + b"".join(rows)


def loaded(path: Path, content: bytes) -> KeyedVectors:
    path.write_bytes(content)
    return load_vectors(Words(source=str(path), text="definition", sha256=None))


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("word2vec.txt", text()),
        ("word2vec.bin", binary()),
        ("glove.txt", glove()),
        ("google.bin", binary(newline=b"")),  # as Google's own file: no newline after a vector
        ("word2vec.txt.gz", gzip.compress(text())),
        ("glove.txt.gz", gzip.compress(glove())),
        ("word2vec.bin.gz", gzip.compress(binary())),
    ],
)
def test_every_form_of_file_gives_the_same_vectors(
    tmp_path: Path, name: str, content: bytes
) -> None:
    read = loaded(tmp_path / name, content)
    assert read.index_to_key == list(VECTORS)
    np.testing.assert_array_equal(read.vectors, np.array(list(VECTORS.values()), dtype=np.float32))


def test_files_that_gensim_writes_are_read_back(tmp_path: Path) -> None:
    saved = KeyedVectors(300)
    saved.add_vectors(
        ["mug", "bowl"], np.random.default_rng(0).normal(size=(2, 300)).astype(np.float32)
    )
    for binary_form in (True, False):
        saved.save_word2vec_format(str(tmp_path / "saved"), binary=binary_form)
        np.testing.assert_array_equal(words.read_vectors(tmp_path / "saved").vectors, saved.vectors)


@pytest.mark.parametrize("form", [text, binary, glove])
def test_a_token_that_is_there_twice_keeps_its_first_vector(
    tmp_path: Path, form: Callable[[dict[str, list[float]]], bytes]
) -> None:
    read = loaded(tmp_path / "words", form(VECTORS).replace(b"clock ", b"alarm "))
    np.testing.assert_array_equal(
        words.look_up(read, ["alarm", "clock", "house plant"]).vectors[:, 0], [1, 0, 0.5]
    )


# Looking up


@pytest.fixture
def known() -> KeyedVectors:
    extra = {"tv stand": [7.0, 7.0, 7.0], "tv_stand": [9.0, 9.0, 9.0], "house": [4.0, 4.0, 4.0]}
    keyed = KeyedVectors(3)
    every = VECTORS | extra
    keyed.add_vectors(list(every), np.array(list(every.values()), dtype=np.float32))
    return keyed


@pytest.mark.parametrize(
    ("phrase", "vector", "served_by"),
    [
        ("clock", [0.0, 1.0, -2.5], "clock"),
        # joined, though both tokens are known, too
        ("house plant", [0.5, 0.25, 8.0], "house_plant"),
        # the phrase as it is comes before the joined one
        ("tv stand", [7.0, 7.0, 7.0], "tv stand"),
        ("alarm clock", [0.5, 0.5, -1.25], "alarm clock"),  # the mean of both
        ("alarm unheard", [1.0, 0.0, 0.0], "alarm"),  # the mean of those that are known
        ("unheard of", [0.0, 0.0, 0.0], None),
    ],
)
def test_a_phrase_is_one_token_or_joined_or_the_mean_of_its_tokens_or_nothing(
    known: KeyedVectors, phrase: str, vector: list[float], served_by: str | None
) -> None:
    looked_up = words.look_up(known, ["unheard", phrase, "alarm"])
    np.testing.assert_allclose(looked_up.vectors, [[0, 0, 0], vector, [1, 0, 0]])
    assert looked_up.vectors.dtype == np.float32
    assert looked_up.served_by == [None, served_by, "alarm"]


# Broken files


@pytest.mark.parametrize("token", ["\u00a0", "\u0085", "\u3000", "snake_case"])
def test_tokens_of_real_files_are_read(tmp_path: Path, token: str) -> None:
    vectors = loaded(tmp_path / "glove.txt", glove({"the": [1.0, 2.0]} | {token: [3.0, 4.0]}))
    assert vectors.index_to_key == ["the", token]
    assert vectors[token].tolist() == [3.0, 4.0]


@pytest.mark.parametrize(
    "damage", [lambda raw: raw[: len(raw) // 2], lambda raw: raw[:20] + b"\0\0\0" + raw[23:]]
)
def test_a_damaged_gz_file_is_named(tmp_path: Path, damage: Callable[[bytes], bytes]) -> None:
    compressed = gzip.compress(
        text({f"token{n}": [n * 0.1, n * 0.7, n * 1.3] for n in range(2000)})
    )
    with pytest.raises(InputError, match=r"words\.txt\.gz"):
        loaded(tmp_path / "words.txt.gz", damage(compressed))


# The shipped vectors


@pytest.fixture(scope="module", params=["definition", "phrase"])
def shipped(request: pytest.FixtureRequest) -> KeyedVectors:
    return load_vectors(Words(source="shipped", text=request.param, sha256=None))


def definitions() -> list[str]:
    table = pd.read_csv(DEFINITIONS, keep_default_na=False)
    assert table["definition"].str.len().gt(10).all()
    assert table["phrase"].is_unique
    return list(table["phrase"])


def object_types() -> list[str]:
    """All object types of AI2-THOR and RoboTHOR in the recording, including the floor."""
    scenes = json.loads(locate("recording").read_bytes())
    return sorted(
        {entity_name(o["objectType"]) for rooms in scenes.values() for room in rooms for o in room}
    )


ROOMS = ["bathroom", "bedroom", "kitchen", "living room"]
SUNCG = ["wood", "metal", "fabric", "glass", "leather", "stone", "tile"]
SIMULATOR = ["metal", "plastic", "wood", "fabric", "glass", "ceramic", "paper", "food", "organic",
             "rubber", "stone", "sponge", "wax", "soap", "leather"]  # fmt: skip
AFFORDANCES = ["open", "close", "pick up", "put", "turn on", "turn off", "fill", "empty", "slice",
               "break", "clean", "dirty", "push", "pull", "cook", "heat", "cool"]  # fmt: skip


def test_the_shipped_vectors_serve_every_phrase_as_one_token(shipped: KeyedVectors) -> None:
    published = published_phrases()["phrase"]
    phrases = [
        *definitions(),
        *object_types(),
        *ROOMS,
        *SUNCG,
        *SIMULATOR,
        *AFFORDANCES,
        *published,
    ]
    assert words.look_up(shipped, phrases).served_by == [
        phrase.replace(" ", "_") for phrase in phrases
    ]


def test_the_shipped_vectors_are_of_unit_length_one_for_each_phrase_and_no_two_alike(
    shipped: KeyedVectors,
) -> None:
    assert shipped.index_to_key == [phrase.replace(" ", "_") for phrase in definitions()]
    assert shipped.vectors.shape == (len(definitions()), 384)
    np.testing.assert_allclose(np.linalg.norm(shipped.vectors, axis=1), 1, atol=1e-5)
    assert len(np.unique(shipped.vectors, axis=0)) == len(shipped.vectors)
    assert shipped.similarity("sofa", "arm_chair") > shipped.similarity("sofa", "egg")
    assert shipped.similarity("sink", "sink_basin") > shipped.similarity("sink", "alarm_clock")


def test_embedding_again_keeps_the_bytes_of_vectors_that_differ_by_rounding_alone() -> None:
    stored = KeyedVectors(3)
    stored.add_vectors(
        ["mug", "bowl"], np.array([[0.6, 0.8, 0.0], [0.0, 0.6, 0.8]], dtype=np.float32)
    )
    again = np.array([[0.600001, 0.8, 0.0], [0.0, 0.6, 0.8], [0.01, 0.59, 0.8]], dtype=np.float32)
    new_bowl = again[2].copy()
    assert reuse(["mug", "pan", "bowl"], again, stored) == 1
    assert again[0].tobytes() == stored["mug"].tobytes()
    np.testing.assert_array_equal(
        again[1:], [np.array([0.0, 0.6, 0.8], dtype=np.float32), new_bowl]
    )
