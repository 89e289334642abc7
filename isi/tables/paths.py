"""Paths of files that are no tables: params, pipelines, shipped data; relative to the folder of ``dvc.yaml``."""

from pathlib import Path

PARAMS = Path("params.yaml")
PIPELINE = Path("dvc.yaml")
BEYOND_PARAMS = Path("beyond") / "params.yaml"  #: Of the second pipeline, beyond the paper.
BEYOND_PIPELINE = Path("beyond") / "dvc.yaml"
DATA = Path("data")
RAW = DATA / "raw"
REPORTS = Path("reports")
FINAL_MODELS = DATA / "final_models"  #: Embeddings that commands of ``isi`` insert into.

MATERIAL_SHARES = RAW / "suncg" / "material_shares.csv"
MATERIAL_CATEGORIES = RAW / "suncg" / "categories.csv"
MP3D_TALLIES = RAW / "mp3d" / "room_object_counts.csv"
PUBLISHED_TRIPLES = RAW / "published" / "triples.csv"
PUBLISHED_PHRASES = RAW / "published" / "phrases.csv"
DEFINITIONS = RAW / "words" / "definitions.csv"
PAPER = RAW / "paper" / "values.yaml"


def shipped_vectors(text: str) -> Path:
    """Word vectors that ship with the product: of definitions or of bare phrases."""
    return RAW / "words" / f"{text}.bin"


def final_model(experiment: str) -> Path:
    """The folder of an experiment's final model, which is trained on its whole graph; ``isi insert`` opens it."""
    return FINAL_MODELS / experiment
