"""A timeline that can be run: an embedding of its first snapshot is carried to the last one."""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
import torch
from torch import Tensor

from isi.benchmark.evaluation import NamedEmbedding, read
from isi.config import Count, Seed, check, check_names, keywords
from isi.continual.along import Along, Step
from isi.continual.chain import Growth, check_classes
from isi.continual.classes import CLASS_MEAN
from isi.continual.experiment import ChainTraining
from isi.continual.measures import continual_measures
from isi.continual.strategies import STRATEGIES
from isi.continual.timeline import Timeline
from isi.errors import InputError
from isi.graph.graph import HEAD, RELATION, TAIL
from isi.graph.vocabulary import Vocabulary
from isi.initializers.api import INITIALIZERS
from isi.insertion.arguments import checked_model, naming_argument, options_by_name
from isi.insertion.inverses import InverseRelations
from isi.models.bilinear import BlockModel
from isi.models.distance import RotatE, Translation
from isi.models.losses import Loss
from isi.models.model import Model
from isi.models.stack import Embedding, usual_torch

if TYPE_CHECKING:
    import pandas as pd

#: How ``Timeline.run`` trains, as kbc does.
TRAINING = {
    "loss": "softmax",
    "batch_size": 1024,
    "learning_rate": 0.1,
    "n3": 0.005,
    "init_range": 0.001,
    "base_epochs": 30,
    "epochs": 5,
}


@dataclass(frozen=True, eq=False, repr=False)
class GrownEmbedding:
    """An embedding after the last snapshot of a timeline, and how it came there."""

    timeline: Timeline
    theta: Embedding
    matrix: pd.DataFrame  #: R[i, j] in the columns of ``evaluate``
    #: ``snapshot``, ``phase``, ``seconds`` of one processor without ranking, ``peak_mib``
    costs: pd.DataFrame

    @property
    def entities(self) -> np.ndarray:
        """Vectors in the order of ``timeline.entity_names``; shape (E, d)."""
        return self.theta.entity[0].numpy()

    @property
    def relations(self) -> np.ndarray:
        """Rows in the order of ``timeline.relation_names``; the second half of a row is that of the
        inverse relation; shape (R, 2w).
        """
        return self.theta.relation[0].numpy()

    @property
    def model(self) -> Model:
        """What scores the rows; ``isi.insert(..., model=grown.model)`` takes it."""
        return self.theta.model

    def measures(self) -> pd.DataFrame:
        """The field's measures of ``matrix`` (``continual_measures``)."""
        return continual_measures(self.matrix)

    def __repr__(self) -> str:
        entities, dimension = self.entities.shape
        seconds = self.costs["seconds"].sum()
        return f"{entities:,} entities of dimension {dimension}, {seconds:.1f} s"


class RunnableTimeline(Timeline):
    """``isi.Timeline``: a graph that grows, and the run along it."""

    @usual_torch()
    def run(
        self,
        model: Any = "complex",
        factory: Any = None,
        *,
        entities: Any = None,
        relations: Any = None,
        entity_names: Sequence[str] | None = None,
        relation_names: Sequence[str] | None = None,
        model_options: Mapping[str, Any] | None = None,
        dimension: int = 200,
        loss: Loss | None = None,
        initializer: str | None = None,
        options: Mapping[str, Any] | None = None,
        strategy: str = "new_rows_and_earlier",
        strategy_options: Mapping[str, Any] | None = None,
        training: Mapping[str, Any] | None = None,
        words: np.ndarray | None = None,
        most: int | None = None,
        seed: int = 0,
    ) -> GrownEmbedding:
        """Carry an embedding from the first snapshot to the last one, and rank all test sets on the
        way.

        Args:
            model: the name of a model, which is trained on the first snapshot. Or your own
                embedding of its entities and relations: the name (or a ``Model``) with
                ``entities``, (E, d), and ``relations``, (R, w); a result of ``isi.insert`` or
                ``isi.pykeen.insert``; a model of PyKEEN's or a result of its pipeline, with its
                ``factory``. A model without
                inverse relations gets them.
            entity_names, relation_names: of the rows of ``entities`` and ``relations``. None: those
                of the timeline.
            dimension: of an embedding that is trained here.
            loss: that your embedding was trained with. None: that of ``training``.
            initializer: of new entities, with ``options``; for the benchmarks, which have classes,
                also class_mean. None: the best by the hold-out test when the first ones arrive.
            strategy: of training at each snapshot, with ``strategy_options``: insert (none),
                new_rows, new_rows_and_earlier, finetune, new_rows_then_all, replay, l2, ewc,
                full_replay, retrain.
            training: replaces parts of ``TRAINING``.
            words: word vectors of all entities of the timeline, (E, v).
            most: maximum number of test triples of a snapshot that are ranked. None: all.

        Raises:
            InputError: names the wrong argument; training diverged.

        Example:
            >>> import isi
            >>> home = [("cup", "in", "kitchen"), ("bed", "in", "bedroom"), ("cup", "on", "bed")]
            >>> later = [("mug", "in", "kitchen"), ("mug", "on", "bed")]
            >>> timeline = isi.Timeline.of([(home, [], home[:1]), (later, [], later[:1])])
            >>> grown = timeline.run("complex", dimension=8, initializer="er_avg")
            >>> grown.entities.shape, grown.relations.shape
            ((5, 8), (2, 16))
            >>> grown.matrix.query("protocol == 'current'")["queries"].to_list()
            [1, 1, 1, 1, 1, 1, 1, 1, 1, 1]
        """
        dimension = check(dimension, Count, "", "argument 'dimension'")
        most = check(most, Count | None, "", "argument 'most'")  # type: ignore[arg-type]
        seed = check(seed, Seed, "", "argument 'seed'")
        settings = {**TRAINING, **options_by_name(training, "training")}
        checked = check(settings, ChainTraining, "", "argument 'training'")
        chosen = options_by_name(strategy_options, "strategy_options")
        check_names([strategy], STRATEGIES, "argument 'strategy'")
        keywords(STRATEGIES[strategy], chosen, "argument 'strategy_options'")
        with naming_argument("initializer"):
            if initializer not in (None, CLASS_MEAN):
                INITIALIZERS.get(initializer)
        check_classes(self, initializer)
        growth = Growth(initializer, options or {}, strategy, chosen, loss or checked.loss)
        along = Along(self, checked.schedule, words, most)
        self._count_without_facts()
        if isinstance(model, str | Model) and entities is None:
            if not len(self.snapshots[0].train):
                raise InputError(
                    "snapshot 0", "train", "expected triples, which a model is trained on"
                )
            steps = [along.first(checked_model(model, model_options, dimension), dimension, seed)]
        else:
            given = read(model, factory, entities, relations, model_options)
            if entity_names is not None or relation_names is not None:
                ids = Vocabulary("entity", entity_names).ids
                label_ids = Vocabulary("relation", relation_names).ids
                given = replace(given, entities=ids, relations=label_ids)
            steps = [along.start_from(self._first_of(given))]
        growth, seconds = along.chosen(steps[0].theta, growth, seed)
        for snapshot in range(1, len(self.snapshots)):
            of_choice = seconds if snapshot == 1 else 0.0
            steps.append(along.next(steps[-1].theta, growth, snapshot, seed, of_choice))
        return _grown(self, steps)

    def _count_without_facts(self) -> None:
        """Warn of names that arrive without a training triple, if there are any."""
        for kind, names, known, slots in (
            ("entities", self.entity_names, self.entities, [HEAD, TAIL]),
            ("relations", self.relation_names, self.relations, [RELATION]),
        ):
            first, without = 0, list[str]()
            for snapshot, last in zip(self.snapshots, known.tolist(), strict=True):
                trained = np.isin(np.arange(first, last), snapshot.train[:, slots])
                without += [names[first + place] for place in np.flatnonzero(~trained)]
                first = last
            if without:
                text = f"{len(without)} {kind} arrive without a training triple, such as"
                warnings.warn(
                    f"{text} {without[0]!r:.80}: nothing is learned of them", stacklevel=4
                )

    def _first_of(self, given: NamedEmbedding) -> Embedding:
        """The rows of the first snapshot, with inverse relations."""
        number, relations = int(self.entities[0]), int(self.relations[0])
        names = self.entity_names[:number], self.relation_names[:relations]
        return with_inverses(given.in_order(names[0], number, names[1]))


def with_inverses(theta: Embedding) -> Embedding:
    """The same embedding with inverse relations, in the packed form: f(t, r⁻¹, h) = f(h, r, t).

    InputError for a model whose relations have no inverse row of that kind.
    """
    if isinstance(theta.model, InverseRelations):
        return theta
    inverse = _inverse_rows(theta.model, theta.relation)
    relation = torch.cat([theta.relation, inverse], -1)
    return Embedding(theta.entity, relation, InverseRelations(theta.model))


def _inverse_rows(model: Model, relation: Tensor) -> Tensor:
    if isinstance(model, Translation | RotatE):
        return -relation
    if isinstance(model, BlockModel):
        scalars, first, second = model.parts(relation)
        return torch.cat([scalars, first, -second], -1)
    expected = "expected a model with inverse relations, or a bilinear one, a translation or RotatE"
    raise InputError("argument 'model'", "", expected)


def _grown(timeline: Timeline, steps: Sequence[Step]) -> GrownEmbedding:
    import pandas as pd

    matrix, costs = (
        pd.concat([getattr(step, name) for step in steps], ignore_index=True)
        for name in ("matrix", "costs")
    )
    return GrownEmbedding(timeline, steps[-1].theta, matrix, costs)
