"""Single insertions, entity by entity: who indicates each, where it is put, and what models answer about it.

The answers of a model to every query about some novel entities, in order, with what is true.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd
import torch
from torch import Tensor

from isi.analyses.trajectory import Plane, on, plane, turn
from isi.config import Count, Name, Study
from isi.experiment.grid import JOINT_MODEL, GridPoints, StackedVectors
from isi.experiment.insert import InsertTask, finetune, initialize, with_vectors
from isi.experiment.tables import FALLBACK_NAMES
from isi.graph.graph import HEAD, RELATION, TAIL
from isi.graph.sessions import OUT, TRAIN
from isi.initializers.api import FALLBACKS, InitContext, InitResult
from isi.initializers.similarity import (
    has_insert_triples,
    has_words,
    mean_relational_score,
    word_eligible,
    word_similarity,
)
from isi.models.stack import Embedding
from isi.tables.rules import at_least, finite, one_of, unique, within
from isi.tables.table import INT, NAME, REAL, Table
from isi.training.trainer import never_stop

#: What a true answer is to a session.
TRUE_NAMES = ("told", "learned", "held_out")
#: One row per entity. ``told``: number of its insert triples. ``shown``: share of the known entities' variance on the
#: two axes of its map. ``fitted``: share of it that the joint model's vectors of them have in common with Θ⁰'s.
SINGLE_INSERTIONS = Table(
    "data/analyses/explorer/{experiment}.parquet",
    {"entity": INT, "seed": INT, "told": INT, "shown": REAL, "fitted": REAL},
    key=["entity"],
    ordered=True,
    checks=[*at_least(0, "entity", "seed", "told"), *within(0, 1, "shown", "fitted")],
    entity_ids=["entity"],
)
#: Indicators of each entity with their weights; ``fallback``: of the initializer that it fell back to. ``by_words``:
#: cosine of word vectors; ``by_relations``: mean of cos(v_e, ᾱ_r) over the relations of the insert triples.
SINGLE_INDICATORS = Table(
    "data/analyses/explorer/{experiment}.indicators.parquet",
    {"entity": INT, "model": NAME, "fallback": NAME, "indicator": INT, "weight": REAL, "by_words": REAL,
     "by_relations": REAL},
    key=["entity", "model", "indicator"],
    checks=[*at_least(0, "entity", "indicator"), *one_of("fallback", FALLBACK_NAMES), *within(0, 1, "weight"),
            *within(-1, 1, "by_words", "by_relations")],
    nullable=["fallback", "by_words", "by_relations"],
    entity_ids=["entity", "indicator"],
)  # fmt: skip
#: Places on the map of a seed: the known entities in Θ⁰, others in a model after an epoch.
SINGLE_PLACES = Table(
    "data/analyses/explorer/{experiment}.places.parquet",
    {"seed": INT, "entity": INT, "model": NAME, "epoch": INT, "x": REAL, "y": REAL},
    key=["seed", "entity", "model", "epoch"],
    checks=[*at_least(0, "seed", "entity", "epoch"), *finite("x", "y")],
    entity_ids=["entity"],
)
#: The first answers to (entity, relation, ?) and (?, relation, entity), and the true ones, ranked among all entities
#: of the session. ``true``: in which way an answer is true; null: it is not.
SINGLE_ANSWERS = Table(
    "data/analyses/explorer/{experiment}.answers.parquet",
    {"entity": INT, "model": NAME, "epoch": INT, "relation": NAME, "hidden": NAME, "answer": INT, "rank": INT,
     "true": NAME},
    key=["entity", "model", "epoch", "relation", "hidden", "answer"],
    checks=[*at_least(0, "entity", "epoch", "answer"), *at_least(1, "rank"), *one_of("hidden", ("tail", "head")),
            *one_of("true", TRUE_NAMES), *unique("entity", "model", "epoch", "relation", "hidden", "rank")],
    nullable=["true"],
    entity_ids=["entity", "answer"],
)  # fmt: skip

#: The paper's initializers that are shown, beside the one that params name.
SHOWN = ("xavier", "es", "rs", "ers")
#: What a map shows of the known entities.
THETA0 = "theta0"

#: What is shown, each in a table of its own: its declaration, and what it is sorted by.
TABLES = {
    "entities": (SINGLE_INSERTIONS, "entity"), "indicators": (SINGLE_INDICATORS, "entity"),
    "places": (SINGLE_PLACES, "seed"), "answers": (SINGLE_ANSWERS, "entity"),
}  # fmt: skip


class ExplorerParams(Study):
    """``explorer`` in params: which insertions are shown, and how much of each."""

    size: Count
    epochs: Count
    #: the initializer that is shown beside ``SHOWN``
    best: Name
    #: of a centre, at most
    indicators: Count
    #: of a query, beside those that are true
    answers: Count


@dataclass(frozen=True)
class SinglesTask:
    """Insert the novel entities of a stack of grid points with each initializer, and show some of them."""

    points: GridPoints
    #: of each initializer
    inserting: Sequence[InsertTask]
    joint: StackedVectors
    #: the seed in which each entity is shown
    seeds: Mapping[int, int]
    config: ExplorerParams


@dataclass(frozen=True)
class Singles:
    """What is shown of the entities of a task: a table of each of ``TABLES``."""

    entities: pd.DataFrame
    indicators: pd.DataFrame
    places: pd.DataFrame
    answers: pd.DataFrame


def first_seeds(novel: pd.DataFrame, size: int) -> dict[int, int]:
    """The first seed in which the first session of a size inserts each entity (``NOVEL``)."""
    own = novel[(novel["size"] == size) & (novel["session"] == 1)].sort_values("seed", kind="stable")
    firsts = own.drop_duplicates("entity")
    return dict(zip(firsts["entity"].tolist(), firsts["seed"].tolist(), strict=True))


def single_insertions(task: SinglesTask) -> Singles:
    """Indicators, places and answers of the entities of a task that are shown."""
    points, joint, picked = task.points, task.joint.stack, pick(task.points, task.seeds)
    theta0, known = task.inserting[0].theta0.stack, points.session(0).entities
    queries = queries_of(points, picked, points.insert_triples_in(1, task.inserting[0].insert_triples))
    planes = [plane(vectors[own]) for vectors, own in zip(theta0.entity, known, strict=True)]
    turned, fitted = turn(joint.entity, theta0.entity, known)
    indicators = list[pd.DataFrame]()
    places = [
        _known_places(points, picked, theta0.entity, planes),
        _places(points, picked, turned, planes, JOINT_MODEL, 0),
    ]
    answers = [answers_of(joint, points, queries, task.config.answers).assign(model=JOINT_MODEL, epoch=0)]
    for inserting in (replace(inserting, points=points) for inserting in task.inserting):
        name, (initial, *embeddings) = inserting.config.initializer, inserted_and_trained(inserting)
        if initial.weights is not None:
            context = inserting.context(inserting.theta0.stack, 1)
            rows = indicators_of(context, initial.weights, initial.fallback, picked, name, task.config.indicators)
            indicators.append(rows)
        for epoch, embedding in zip((0, task.config.epochs), embeddings, strict=True):
            places.append(_places(points, picked, embedding.entity, planes, name, epoch))
            answers.append(answers_of(embedding, points, queries, task.config.answers).assign(model=name, epoch=epoch))
    entities = pd.DataFrame({
        "entity": picked.entity.cpu().numpy(), "seed": _seeds(points, picked),
        "told": (queries.truth == TOLD).sum((1, 2, 3)).cpu().numpy(),
        "shown": [planes[model].share for model in picked.model.tolist()], "fitted": fitted[picked.model].cpu().numpy(),
    })  # fmt: skip
    return Singles(entities, *(pd.concat(parts) for parts in (indicators, places, answers)))


def inserted_and_trained(task: InsertTask) -> tuple[InitResult, Embedding, Embedding]:
    """What an initializer gives, and the embedding as inserted and after all epochs of training."""
    theta0 = task.theta0.stack
    initial = initialize(task, theta0, 1)
    inserted = with_vectors(theta0, task.points.novel_in(1), initial.vectors)
    return initial, inserted, finetune(task, inserted, 1, never_stop)


# Indicators


def indicators_of(
    insertion: InitContext, weights: Tensor, fallback: Tensor, picked: Picked, model: str, most: int
) -> pd.DataFrame:
    """The entities of largest weight in the centre of each vector (``SINGLE_INDICATORS``), most similar first.

    Args:
        weights: shape (M, n, E).
        fallback: whose they are, an index into ``FALLBACKS``; shape (M, n).
    """
    named = (has_words(insertion)[..., None] & word_eligible(insertion)).expand_as(weights)
    told = has_insert_triples(insertion)[..., None].expand_as(weights)
    k, indicator = (picked.of(weights) > 0).nonzero(as_tuple=True)

    def column(values: Tensor) -> np.ndarray:
        return picked.of(values)[k, indicator].double().cpu().numpy()

    frame = pd.DataFrame({
        "entity": picked.entity[k].cpu().numpy(), "indicator": indicator.cpu().numpy(), "weight": column(weights),
        "by_words": column(word_similarity(insertion).masked_fill(~named, torch.nan)),
        "by_relations": column(mean_relational_score(insertion).masked_fill(~told, torch.nan)),
        "fallback": np.array(FALLBACKS, dtype=object)[picked.of(fallback)[k].cpu().numpy()],
    })  # fmt: skip
    similar = ["by_words", "by_relations"] if model == "es" else ["by_relations", "by_words"]
    frame = frame.sort_values(["weight", *similar], ascending=False, kind="stable")
    frame = frame.groupby("entity", sort=False).head(most).sort_values("entity", kind="stable")
    return frame.assign(model=model)


# Places


def _places(
    points: GridPoints, picked: Picked, entity: Tensor, planes: Sequence[Plane], model: str, epoch: int
) -> pd.DataFrame:  # fmt: skip
    """Of novel entities, where tables of shape (M, E, d) have them (``SINGLE_PLACES``)."""
    places = torch.stack([on(planes[m], entity[m, e]) for m, e in zip(picked.model, picked.entity, strict=True)])
    x, y = places.T.cpu().numpy()
    frame = pd.DataFrame({"seed": _seeds(points, picked), "entity": picked.entity.cpu().numpy(), "x": x, "y": y})
    return frame.assign(model=model, epoch=epoch)


def _known_places(points: GridPoints, picked: Picked, entity: Tensor, planes: Sequence[Plane]) -> pd.DataFrame:
    """The same of the known entities of each seed in which one is shown, in Θ⁰."""
    known, parts = points.session(0).entities, []
    for model in sorted(set(picked.model.tolist())):
        x, y = on(planes[model], entity[model, known[model]]).T.cpu().numpy()
        ids = known[model].nonzero().flatten().cpu().numpy()
        parts.append(pd.DataFrame({"seed": points.seeds[model], "entity": ids, "x": x, "y": y}))
    return pd.concat(parts).assign(model=THETA0, epoch=0)


def _seeds(points: GridPoints, picked: Picked) -> list[int]:
    return [points.seeds[model] for model in picked.model.tolist()]


#: Columns of triples with the end that a query hides, and with the one that it gives.
HIDDEN = {"tail": (TAIL, HEAD), "head": (HEAD, TAIL)}
#: What a true answer is to a session; none: not true.
TRUE = (None, *TRUE_NAMES)
TOLD, LEARNED, HELD_OUT = 1, 2, 3


@dataclass(frozen=True)
class Picked:
    """The novel entities of a stack that are shown: their model, place in ``novel``, and id; shapes (K,)."""

    model: Tensor
    place: Tensor
    entity: Tensor

    def of(self, values: Tensor) -> Tensor:
        """Values of novel entities, (M, n, ...), of those alone; shape (K, ...)."""
        return values[self.model, self.place]


@dataclass(frozen=True)
class ExplorerQuery:
    """Queries about the entities that are shown: (entity, relation, ?) and (?, relation, entity)."""

    picked: Picked
    #: who may answer; shape: (K, E), bool
    candidates: Tensor
    #: which are asked, by relation and by what is hidden, in the order of ``HIDDEN``; shape: (K, R, 2), bool
    asked: Tensor
    #: what each answer is, an index into ``TRUE``; shape: (K, R, 2, E), int8
    truth: Tensor


def pick(points: GridPoints, seeds: Mapping[int, int]) -> Picked:
    """The novel entities of a stack that are shown in its seeds; ``seeds``: of entities."""
    novel = points.novel_in(1)
    wanted = torch.tensor([[seeds[entity] == seed for entity in own]
                           for own, seed in zip(novel.tolist(), points.seeds, strict=True)])  # fmt: skip
    model, place = wanted.nonzero(as_tuple=True)
    return Picked(model, place, novel[model, place])


def queries_of(points: GridPoints, picked: Picked, told: Tensor) -> ExplorerQuery:
    """The queries of entities that are shown: for the ends that entities of their kind are of triples.

    Args:
        told: the insert triples; shape (M, T), bool.
    """
    graph, session = points.graph, points.session(1)
    code = torch.where(session.splits == TRAIN, torch.where(told, TOLD, LEARNED), HELD_OUT)
    code = code.masked_fill(session.splits == OUT, 0).to(torch.int8)
    shape = len(graph.relations), len(HIDDEN)
    takes = torch.zeros(int(graph.kinds.max()) + 1, *shape, dtype=torch.bool)
    truth = torch.zeros(len(picked.entity), *shape, len(graph.entities), dtype=torch.int8)
    relation = graph.triples[:, RELATION]
    for side, (hidden, given) in enumerate(HIDDEN.values()):
        takes[graph.kinds[graph.triples[:, given]], relation, side] = True
        k, triple = (graph.triples[:, given] == picked.entity[:, None]).nonzero(as_tuple=True)
        truth[k, relation[triple], side, graph.triples[triple, hidden]] = code[picked.model[k], triple]
    return ExplorerQuery(picked, session.entities[picked.model], takes[graph.kinds[picked.entity]], truth)


def answers_of(embedding: Embedding, points: GridPoints, queries: ExplorerQuery, first: int) -> pd.DataFrame:
    """The first answers to each query and the true ones, in order (``SINGLE_ANSWERS``); equal scores by id."""
    novel, picked = points.novel_in(1), queries.picked
    scores = torch.stack([
        torch.stack([picked.of(embedding.score_tails(novel, relation)),
                     picked.of(embedding.score_heads(relation, novel))], 1)
        for relation in (torch.full_like(novel, number) for number in range(len(points.graph.relations)))
    ], 1)  # fmt: skip
    barred = ~queries.candidates[:, None, None]
    order = scores.masked_fill(barred, -torch.inf).sort(dim=-1, descending=True, stable=True).indices
    rank = order.argsort(-1) + 1
    shown = queries.asked[..., None] & ~barred & ((rank <= first) | (queries.truth > 0))
    k, relation, side, place = shown.gather(-1, order).nonzero(as_tuple=True)
    answer = order[k, relation, side, place]
    return pd.DataFrame({
        "entity": picked.entity[k].cpu().numpy(), "relation": np.array(points.graph.relations)[relation.cpu().numpy()],
        "hidden": np.array(list(HIDDEN))[side.cpu().numpy()], "answer": answer.cpu().numpy(),
        "rank": place.cpu().numpy() + 1,
        "true": np.array(TRUE, dtype=object)[queries.truth[k, relation, side, answer].cpu().numpy()],
    })  # fmt: skip
