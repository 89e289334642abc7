"""Tasks of training and insertion on a small grid."""

from collections.abc import Sequence
from functools import cache

import numpy as np
import pandas as pd

from isi.config import Option
from isi.evaluation.query_sets import GROUPS
from isi.models.stack import Embedding
from isi.training.batches import Negatives
from isi.training.fit import TrainConfig
from isi.training.trainer import Optimizer, Training
from stages.grid import GridPoints
from stages.insert import InsertConfig, InsertTask, StackResult
from stages.train_theta0 import TrainResult, train_stack
from tests.init_contexts import EVERYONE
from tests.small_graphs import ANALOGY, points_of, random_graph

ENTITIES, RELATIONS, SIZE, SEEDS = 14, 3, 2, [0, 1, 2, 3]
GRAPH = random_graph(ENTITIES, RELATIONS, 90)
SAMPLED = Negatives(mode="sampled", ratio=3)
#: Options of the models whose options have no default.
MODEL_OPTIONS: dict[str, dict[str, Option]] = {
    "transe": {"margin": 4.0, "squared": False},
    "rotate": {"margin": 4.0, "squared": False},
    "transe_l1": {"margin": 4.0},
}
TRAINING = Training(
    batch_size=80, learning_rate=0.1, weight_decay=1e-3, max_epochs=8, evaluate_every=2, patience=1
)
LEARNING = TrainConfig(
    root=0, model=ANALOGY, dimension=12, init_range=0.01, negatives=SAMPLED, training=TRAINING
)
OPTIMIZER = Optimizer(batch_size=80, learning_rate=0.05, weight_decay=1e-3, max_epochs=5)
MARGIN = 0.05
INITIALIZERS = {
    name: EVERYONE[name]
    for name in (*("xavier", "iu", "es", "rs", "ers", "mean", "gaussian", "es_permuted"),)
}
WORDS = np.random.default_rng(0).normal(size=(ENTITIES, 6)).astype(np.float32)
#: MRR of the joint models in both groups, by seed: the first is reached soon, the last one never.
JOINT = np.array([0.1, 0.5, 0.6, 2.0])


def stacks(height: int) -> list[GridPoints]:
    firsts = range(0, len(SEEDS), height)
    return [points_of(GRAPH, SIZE, SEEDS[first : first + height]) for first in firsts]


def training_tasks(
    height: int, config: TrainConfig = LEARNING
) -> list[tuple[GridPoints, TrainConfig]]:
    return [(points, config) for points in stacks(height)]


@cache
def _trained() -> Embedding:
    return train_stack(*stacks(len(SEEDS)), LEARNING).theta


def theta0() -> Embedding:
    """A copy of Θ⁰ of all seeds, which a test may change."""
    return Embedding(_trained().entity.clone(), _trained().relation.clone(), ANALOGY)


def some_models(theta: Embedding, models: slice | list[int]) -> Embedding:
    """The embeddings of a stack at these indices."""
    return Embedding(theta.entity[models], theta.relation[models], theta.model)


def insert_tasks(
    height: int,
    name: str,
    trained: Embedding,
    words: np.ndarray = WORDS,
    full_curves: Sequence[int] = (),
) -> list[InsertTask]:
    """Tasks of an initializer, all of whose seeds are fine-tuned."""
    config = InsertConfig(
        initializer=name,
        options=INITIALIZERS[name],
        root=0,
        negatives=SAMPLED,
        optimizer=OPTIMIZER,
        margin=MARGIN,
        finetuned=len(SEEDS),
        full_curves=full_curves,
        breaks_down=True,
    )
    tasks = []
    for number, points in enumerate(stacks(height)):
        models = slice(number * height, (number + 1) * height)
        joint = {"none": {group: JOINT[models].copy() for group in GROUPS}}
        tasks.append((points, some_models(trained, models), words, joint, config))
    return tasks


def trained_bytes(trained: list[TrainResult]) -> dict[str, bytes]:
    """All results of training as bytes, sorted by seed and epoch; CSV has all digits of floats."""
    tensors = {
        "entity": [result.theta.entity for result in trained],
        "relation": [result.theta.relation for result in trained],
        "known": [result.known for result in trained],
    }
    log = pd.concat([result.log for result in trained]).sort_values(["seed", "epoch"])
    return {name: np.concatenate(parts).tobytes() for name, parts in tensors.items()} | {
        "log": csv(log)
    }


def inserted_bytes(inserted: list[StackResult]) -> dict[str, bytes]:
    """All results of insertion as bytes, sorted by seed, epoch and scope."""
    vectors = np.concatenate([result.vectors for result in inserted])
    runs = pd.concat([result.runs for result in inserted]).sort_values(["seed", "epoch", "scope"])
    queries = pd.concat([result.queries for result in inserted])
    queries = queries.sort_values("seed", kind="stable")
    return {"vectors": vectors.tobytes(), "runs": csv(runs), "queries": csv(queries)}


def csv(table: pd.DataFrame) -> bytes:
    return table.to_csv(index=False).encode()
