"""Paths of params, pipelines and shipped data, relative to the folder of ``dvc.yaml``;
tables declare their own.
"""

from pathlib import Path

PARAMS = Path("params.yaml")
PIPELINE = Path("dvc.yaml")
BEYOND_PARAMS = Path("beyond") / "params.yaml"  #: params of the second pipeline, beyond the paper
BEYOND_PIPELINE = Path("beyond") / "dvc.yaml"
DATA = Path("data")
RAW = DATA / "raw"
REPORTS = Path("reports")
FINAL_MODELS = DATA / "final_models"  #: Embeddings into which commands of ``isi`` insert.

MATERIAL_SHARES = RAW / "suncg" / "material_shares.csv"
MATERIAL_CATEGORIES = RAW / "suncg" / "categories.csv"
MP3D_TALLIES = RAW / "mp3d" / "room_object_counts.csv"
PUBLISHED_TRIPLES = RAW / "published" / "triples.csv"
PUBLISHED_FOLDS = RAW / "published" / "folds.csv"  #: Its authors' splits.
PUBLISHED_PHRASES = RAW / "published" / "phrases.csv"
DEFINITIONS = RAW / "words" / "definitions.csv"
PAPER = RAW / "paper" / "values.yaml"


def shipped_vectors(text: str) -> Path:
    """Path of shipped word vectors; ``text`` is definition, phrase, wordnet or glove."""
    return RAW / "words" / f"{text}.bin"


def final_model(experiment: str) -> Path:
    """The folder of an experiment's final model, which is trained on its whole graph;
    ``isi insert`` opens it.
    """
    return FINAL_MODELS / experiment
