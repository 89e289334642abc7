"""Every path of the pipeline, once, relative to the folder that holds ``dvc.yaml``."""

from __future__ import annotations

from pathlib import Path

PARAMS = Path("params.yaml")
PIPELINE = Path("dvc.yaml")
#: What lies beyond the paper: a pipeline and params of its own, whose stages run beside those of the first.
BEYOND_PARAMS = Path("beyond") / "params.yaml"
BEYOND_PIPELINE = Path("beyond") / "dvc.yaml"
DATA = Path("data")
RAW = DATA / "raw"
REPORTS = Path("reports")
#: Embeddings that commands of ``isi`` insert into.
KEPT = DATA / "kept"

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


def observations(source: str) -> Path:
    return DATA / "observations" / f"{source}.parquet"


def kinds(source: str) -> Path:
    """The entities of a source: their kinds and phrases."""
    return DATA / "observations" / f"{source}.entities.parquet"


def mined(source: str) -> Path:
    """What each step of mining a source left."""
    return DATA / "observations" / f"{source}.mined.parquet"


def entities(experiment: str) -> Path:
    return DATA / "graph" / experiment / "entities.parquet"


def triples(experiment: str) -> Path:
    return DATA / "graph" / experiment / "triples.parquet"


def vectors(experiment: str) -> Path:
    return DATA / "words" / experiment / "vectors.safetensors"


def coverage(experiment: str) -> Path:
    return DATA / "words" / experiment / "coverage.parquet"


def splits(experiment: str) -> Path:
    return DATA / "sessions" / experiment / "splits.parquet"


def novel(experiment: str) -> Path:
    return DATA / "sessions" / experiment / "novel.parquet"


def insert_triples(experiment: str) -> Path:
    return DATA / "sessions" / experiment / "insert_triples.parquet"


def theta0(experiment: str, size: int) -> Path:
    return DATA / "embeddings" / experiment / "theta0" / f"size={size:02d}.safetensors"


def joint(experiment: str) -> Path:
    return DATA / "embeddings" / experiment / "joint.safetensors"


def training_log(experiment: str, model: str) -> Path:
    return DATA / "embeddings" / experiment / f"{model}.log.parquet"


def runs(experiment: str, name: str) -> Path:
    return DATA / "runs" / experiment / f"{name}.parquet"


def initial_vectors(experiment: str, initializer: str) -> Path:
    return DATA / "runs" / experiment / f"{initializer}.safetensors"


def inserted(experiment: str, name: str) -> Path:
    return DATA / "runs" / experiment / f"{name}.inserted.parquet"


def ties(experiment: str, name: str) -> Path:
    return DATA / "runs" / experiment / f"{name}.ties.parquet"


def affordances(experiment: str) -> Path:
    return DATA / "studies" / "affordances" / f"{experiment}.parquet"


def asked(experiment: str) -> Path:
    return DATA / "studies" / "asking" / f"{experiment}.parquet"


def used(experiment: str) -> Path:
    """Which coordinates the joint model uses."""
    return DATA / "studies" / "asking" / f"{experiment}.used.parquet"


def nothing(experiment: str) -> Path:
    """What further training alone does to Θ⁰."""
    return DATA / "studies" / "nothing" / f"{experiment}.parquet"


def indicator_sweep(experiment: str, initializer: str) -> Path:
    return DATA / "studies" / "indicators" / experiment / f"{initializer}.parquet"


def rate_sweep(experiment: str, initializer: str) -> Path:
    return DATA / "studies" / "rates" / experiment / f"{initializer}.parquet"


def cross_validation(experiment: str) -> Path:
    return DATA / "studies" / "cross_validation" / f"{experiment}.parquet"


def approach(experiment: str) -> Path:
    return DATA / "studies" / "approach" / f"{experiment}.safetensors"


def variant(name: str) -> Path:
    """Runs of experiments under other conditions."""
    return DATA / "beyond" / f"{name}.parquet"


def variant_asked(name: str) -> Path:
    """What is answered at once under other conditions."""
    return DATA / "beyond" / f"{name}.asked.parquet"


def explored(graph: str, what: str) -> Path:
    """What an experiment on a graph of the second pipeline gives: entities, triples, runs or asked."""
    return DATA / "beyond" / "graphs" / graph / f"{what}.parquet"


def families(experiment: str, family: str) -> Path:
    return DATA / "studies" / "families" / experiment / f"{family}.parquet"


def explorer(experiment: str, what: str) -> Path:
    """Single insertions, entity by entity, for the report's explorer: entities, indicators, places or answers."""
    return DATA / "studies" / "explorer" / f"{experiment}{f'.{what}' * (what != 'entities')}.parquet"


def kept(experiment: str) -> Path:
    """The folder of the embedding of all of an experiment's graph, which commands of ``isi`` insert into."""
    return KEPT / experiment


def hidden(graph: str) -> Path:
    """What an embedding of a graph that another trainer made answers about entities that were hidden from it."""
    return DATA / "beyond" / "hidden" / f"{graph}.parquet"


def hidden_seconds(graph: str) -> Path:
    """How long that took."""
    return DATA / "beyond" / "hidden" / f"{graph}.seconds.json"
