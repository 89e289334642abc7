"""Paths of params and shipped data, relative to the folder of a checkout."""

from pathlib import Path

PARAMS = Path("params.yaml")
DATA = Path("data")
RAW = DATA / "raw"

MATERIAL_SHARES = RAW / "suncg" / "material_shares.csv"
MATERIAL_CATEGORIES = RAW / "suncg" / "categories.csv"
MP3D_TALLIES = RAW / "mp3d" / "room_object_counts.csv"
PUBLISHED_TRIPLES = RAW / "published" / "triples.csv"
PUBLISHED_PHRASES = RAW / "published" / "phrases.csv"


def shipped_vectors(text: str) -> Path:
    """Path of shipped word vectors; ``text`` is definition, phrase, wordnet or glove."""
    return RAW / "words" / f"{text}.bin"
