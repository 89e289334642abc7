"""Tables of what an experiment trains, inserts and measures; analyses make theirs of the same columns."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import pyarrow as pa

from isi.evaluation.ranking import MEASURES
from isi.tables.rules import Rule, at_least, mean_of, measured, named, one_of, within
from isi.tables.table import BOOL, INT, NAME, REAL, Table, TensorFile

SCOPES = ("all", "known", "known_closed", "novel", "novel_heldout")
#: What an initializer falls back to where it lacks what it needs.
FALLBACK_NAMES = ("es", "rs", "centroid")

MEASURE_COLUMNS = dict.fromkeys(MEASURES, REAL)
#: MRR* is the mean of its halves.
HALVES = mean_of(*MEASURES[:3])
#: Point of the grid.
SIZE_AND_SEED = {"size": INT, "seed": INT}
SESSION_CHECKS = [*at_least(1, "size"), *at_least(0, "seed"), *at_least(1, "session")]


def runs_table(template: str, by: Mapping[str, pa.DataType] | None = None, checks: Sequence[Rule] = ()) -> Table:
    """Measures of models, epoch by epoch.

    Args:
        template: of the path.
        by: columns that distinguish the runs of one grid point.
        checks: of these columns.
    """
    return Table(
        template,
        {**(by or {}), **SIZE_AND_SEED, "epoch": INT, "scope": NAME, **MEASURE_COLUMNS, "queries": INT, "session": INT},
        key=[*(by or {}), "size", "seed", "session", "epoch", "scope"],
        ordered=True,
        checks=[*checks, *SESSION_CHECKS, *at_least(0, "epoch"), *one_of("scope", SCOPES),
                *measured(MEASURES, "queries"), *HALVES],
        nullable=MEASURES,
    )  # fmt: skip


#: Tensors ``entity`` (S, E, d), ``relation`` (S, R, d), ``known`` (S, E) and ``seed`` (S); zeros for novel entities.
THETA0 = TensorFile("data/embeddings/{experiment}/theta0/size={size:02d}.safetensors")
#: The same tensors; ``known``: entities of the seed's D¹.
JOINT = TensorFile("data/embeddings/{experiment}/joint.safetensors")
#: Validation of a model, Θ⁰ or joint, as training evaluates it. The joint model has size 0.
TRAINING_LOG = Table(
    "data/embeddings/{experiment}/{model}.log.parquet",
    {**SIZE_AND_SEED, "epoch": INT, **MEASURE_COLUMNS, "kept": BOOL},
    key=["size", "seed", "epoch"],
    ordered=True,
    checks=[*at_least(0, "size", "seed"), *at_least(1, "epoch"), *within(0, 1, *MEASURES), *HALVES],
    nullable=MEASURES,  # of a model without validation triples
)
#: Of each initializer, and of the joint model. ``queries`` counts triples, of each of which all three slots are hidden.
RUNS = runs_table("data/runs/{experiment}/{model}.parquet")
#: Vectors of the novel entities before training: tensors ``size=NN``, shape (S, n, d), in the order of ``NOVEL``.
INITIAL_VECTORS = TensorFile("data/runs/{experiment}/{initializer}.safetensors")
#: One row per inserted entity: measures of its own queries of scope ``novel`` at epoch 0, and what it fell back to.
INSERTED = Table(
    "data/runs/{experiment}/{initializer}.inserted.parquet",
    {**SIZE_AND_SEED, "entity": INT, "kind": NAME, "fallback": NAME, **MEASURE_COLUMNS, "queries": INT, "ties": INT,
     "session": INT},
    key=["size", "seed", "session", "entity"],
    ordered=True,
    checks=[*SESSION_CHECKS, *at_least(0, "entity", "ties"), *named("kind"), *one_of("fallback", FALLBACK_NAMES),
            *measured(MEASURES, "queries"), *HALVES],
    nullable=["fallback", *MEASURES],
    entity_ids=["entity"],
)  # fmt: skip
#: Candidates whose score is tied with the answer's, at epoch 0.
TIES = Table(
    "data/runs/{experiment}/{model}.ties.parquet",
    {**SIZE_AND_SEED, "scope": NAME, "ties": INT, "session": INT},
    key=["size", "seed", "session", "scope"],
    ordered=True,
    checks=[*SESSION_CHECKS, *at_least(0, "ties"), *one_of("scope", SCOPES)],
)
