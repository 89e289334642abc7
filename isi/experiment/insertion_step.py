"""One step of incremental learning: novel entities inserted into an embedding, which then learns on (section 5.2)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

from torch import Tensor

from isi.config import Option
from isi.evaluation import query_sets
from isi.evaluation.ranking import Result, evaluate
from isi.graph.sessions import Session
from isi.initializers.api import INITIALIZERS, InitResult, NovelEntities, context_of
from isi.models.stack import Embedding
from isi.training import trainer
from isi.training.batches import Negatives, training_data
from isi.training.trainer import ConvergenceWatch, EpochMeasures, Optimizer, Watch


@dataclass(frozen=True)
class InsertConfig:
    """How novel entities are inserted, and Θ is trained after that."""

    initializer: str
    options: Mapping[str, Option]
    #: root of the random streams, and what each model's depend on beside it; shape: (M, K)
    root: int
    keys: Tensor
    negatives: Negatives
    optimizer: Optimizer
    #: MRR* from which a model counts as converged, by scope; NaN where it is not asked; shape: (M,)
    targets: dict[str, Tensor]
    #: train all models for ``max_epochs``
    to_the_end: bool


@dataclass(frozen=True)
class SessionResult:
    """What became of a step."""

    #: Θⁿ of each model when it had converged, or after the last epoch
    theta: Embedding
    initial: InitResult
    #: measures right after insertion: scope ``novel``, and that scope about one novel entity at a time
    at_once: dict[str, Result]
    own: list[Result]
    #: measures before training and after every epoch
    followed: list[EpochMeasures]


def run_session(
    theta: Embedding, before: Session, after: Session, told: NovelEntities, how: InsertConfig
) -> SessionResult:
    """Insert the novel entities, measure at once in every scope, fine-tune, and measure after every epoch.

    Args:
        theta: Θⁿ⁻¹, learned on Dⁿ⁻¹; rows of novel entities are not looked at.
        before: Dⁿ⁻¹.
        after: Dⁿ.
    """
    initial = initialize(theta, before, told, how)
    inserted, mask = with_vectors(theta, told.novel, initial.vectors), told.mask(len(after.graph.triples))
    at_once = evaluate(inserted, query_sets.novel_query_set(after, told.novel, mask))
    own = [evaluate(inserted, {"own": queries})["own"]
           for queries in query_sets.entity_query_sets(after, told.novel, mask)]  # fmt: skip
    watch = ConvergenceWatch(query_sets.epoch_query_sets(after, told.novel), how.targets, how.to_the_end)
    return SessionResult(finetune(inserted, after, told.novel, how, watch), initial, at_once, own, watch.epochs)


def initialize(theta: Embedding, before: Session, told: NovelEntities, how: InsertConfig) -> InitResult:
    """Vectors of the novel entities by the initializer (equation 8)."""
    registered = INITIALIZERS.get(how.initializer, f"initializers.{how.initializer}")
    return registered.initialize(context_of(theta, before, told, how.root, how.keys), how.options)


def finetune(theta: Embedding, session: Session, novel: Tensor, how: InsertConfig, watch: Watch) -> Embedding:
    """Fine-tune Θ on a session that has novel entities, ids (M, n), watched after every epoch (section 5.2)."""
    data = training_data(session, "fine-tuning", how.keys, how.negatives.head_pool, novel)
    return trainer.train(theta, data, how.negatives, how.optimizer, how.root, watch)


def with_vectors(theta: Embedding, novel: Tensor, vectors: Tensor) -> Embedding:
    """Θ with the vectors of novel entities, (M, n, d), in place (equations 8 and 9)."""
    return replace(theta, entity=theta.entity.scatter(1, novel[..., None].expand_as(vectors), vectors))
