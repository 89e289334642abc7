"""Settings of training: those that follow from the size of a graph, and the comparison of others on
validation triples.

Loss, negatives and optimizer are the pipeline's, except that weight decay is ``DECAY`` / E (an
entity has a share of about 1 / E in the mean gradient of a batch; the paper's 0.001 holds rare
entities near zero), and that tables start in ±``INIT_RANGE`` (in ±0.01 the gradients of product
models almost vanish).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from operator import itemgetter

import numpy as np
import pandas as pd
import torch
from torch import Tensor
from tqdm import tqdm

from isi.config import Option, check
from isi.errors import InputError
from isi.graph.graph import Graph
from isi.graph.sessions import VALID, Session
from isi.insertion.arguments import checked_model, naming_argument
from isi.models.model import MODELS, compared_models
from isi.models.stack import NotFinite
from isi.training.batches import DENSE_LIMIT, Negatives, is_dense, scaled_counts
from isi.training.fit import TrainConfig, fit
from isi.training.trainer import Training

RATES = (0.1, 0.3)  #: Learning rates that are compared.
DECAY, INIT_RANGE = 0.01, 0.3
DRAWS = 4  #: Random choices of validation triples; each setting trains a model for each of them.
LEAST, MOST = 20, 200  #: Epochs of a setting.
#: On a large graph (not ``is_dense``): maximum number of observations in a batch; negatives of each
#: kind.
LARGEST_BATCH, SAMPLED = 1024, 3
#: Maximum number of observations of an epoch: this number, or this many per triple if that is more.
OBSERVED, PER_TRIPLE = 2**18, 10
#: Multiplications in a second in dense batches, numbers of vectors in a second in lists, seconds
#: for each update: they turn a budget of seconds into one of work, so that the result depends on
#: the arguments alone.
DENSE_RATE, LIST_RATE, OVERHEAD = 1.4e10, 1e8, 5e-4


@dataclass(frozen=True)
class Plan:
    """How a graph is trained, so that one setting at least fits into a budget of seconds."""

    graph: Graph  #: with counts that may be scaled down
    batch_size: int
    negatives: Negatives
    cells: int  #: of a dense table of scores: R · E²
    seconds: float  #: of an epoch of one model, by an estimate of its work

    @property
    def draws(self) -> int:
        """Number of random choices of validation triples."""
        return max(1, min(DRAWS, DENSE_LIMIT // self.cells))

    def configs(
        self, model: str | None, learning_rate: float | None, dimension: int, seed: int
    ) -> dict[TrainConfig, str]:
        """How models are trained when settings are compared, and the name of each: that of
        ``train_bundle``'s arguments, or all that are compared.
        """
        with naming_argument("model"):
            options_of = {
                name: dict(MODELS.get(name).defaults)
                for name in ([model] if model else compared_models())
            }
        rates = RATES if learning_rate is None else (learning_rate,)
        return {
            self._config(name, options, rate, dimension, seed): name
            for rate in rates
            for name, options in options_of.items()
        }

    def _config(
        self, name: str, options: Mapping[str, Option], rate: float, dimension: int, seed: int
    ) -> TrainConfig:
        training = Training(
            batch_size=self.batch_size,
            learning_rate=rate,
            weight_decay=DECAY / len(self.graph.entities),
            max_epochs=LEAST,
            evaluate_every=5,
            patience=4,
        )
        model = checked_model(name, options, dimension)
        return TrainConfig(seed, model, dimension, INIT_RANGE, self.negatives, training)


def plan_of(whole: Graph, dimension: int, budget: float) -> Plan:
    """Counts, batches and negatives by the size of a graph and the budget."""
    dense = is_dense(whole)
    mode, ratio = ("expected", 9) if dense else ("sampled", SAMPLED)
    most = max(OBSERVED, PER_TRIPLE * len(whole.triples))
    if not dense:  # time grows with the observations, and one setting is always tried
        seconds_each = dimension * (1 + 3 * ratio) / LIST_RATE
        most = min(most, int(budget / (LEAST * DRAWS * seconds_each)))
    graph = replace(whole, counts=scaled_counts(whole.counts, max(most, len(whole.triples))))
    entities, relations = len(graph.entities), len(graph.relations)
    observed, cells = int(graph.counts.sum()), relations * entities**2
    batch_size = max(1, min(observed // 10, observed if dense else LARGEST_BATCH))
    updates = observed / batch_size
    vectors = observed * (1 + 3 * ratio) + updates * (entities + relations)
    work = updates * cells * 6 / DENSE_RATE if dense else vectors / LIST_RATE
    seconds = updates * OVERHEAD + dimension * work
    negatives = check({"mode": mode, "ratio": ratio}, Negatives, "", "")
    return Plan(graph, batch_size, negatives, cells, seconds)


def keys_of(splits: np.ndarray | Tensor) -> Tensor:
    """Keys of the random streams of a stack with one model for each row of splits, (M, T);
    shape (M, 2).
    """
    return torch.tensor([[0, model] for model in range(len(splits))])


def compare(
    session: Session, configs: Sequence[TrainConfig], affordable: int
) -> tuple[TrainConfig, int]:
    """The best configuration by MRR* of the ends of validation triples, and its epochs;
    the first without such triples.

    ``affordable``: number of epochs in all; limits the configurations that are compared, and their
    epochs.
    """
    if not (session.splits == VALID).any():
        return configs[0], LEAST
    compared = configs[: max(1, affordable // LEAST)]
    failed, tried = None, list[tuple[float, TrainConfig, int]]()
    epochs = min(MOST, max(LEAST, affordable // len(compared)))
    for config in tqdm(compared, "settings", leave=False, disable=None):
        training = config.training.model_copy(update={"max_epochs": epochs})
        try:
            changed = replace(config, training=training)
            _, looks = fit(session, keys_of(session.splits), changed)
            by_draw = pd.concat(looks).pivot(
                index="epoch", columns="place", values="mrr_star_entity"
            )
            curve = by_draw.ffill().mean(axis=1)  # some draws stop earlier
            best = int(curve.index.to_numpy()[curve.to_numpy().argmax()])
            tried.append((curve.max(), config, best))
        except NotFinite as error:
            failed = error
    if failed and not tried:
        raise InputError("argument 'learning_rate'", "", failed.message) from failed
    return max(tried, key=itemgetter(0))[1:]
