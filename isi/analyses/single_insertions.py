"""Single insertions: the trajectory of one entity (Figure 1); indicators, position and answers of each entity."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
import torch
from torch import Tensor

from isi.config import Count, Name, Seed, Study
from isi.experiment.grid import JOINT_MODEL, GridPoints
from isi.experiment.insert import InsertConfig, finetune, init_context, initialize, with_vectors
from isi.experiment.store import FALLBACK_NAMES
from isi.graph.graph import HEAD, RELATION, TAIL
from isi.graph.sessions import OUT, TRAIN
from isi.initializers import similarity
from isi.initializers.api import FALLBACKS, InitContext, InitResult
from isi.models.stack import Embedding
from isi.tables.rules import ENTITY, FROM_0, FROM_1, NAME, REAL, SHARE, one_of, unique, within
from isi.tables.table import Table, TensorFile
from isi.training.trainer import never_stop

#: ``entity``, ``known``, ``theta0``, and of each initializer ``NAME.path`` and ``NAME.indicators``.
TRAJECTORY = TensorFile("data/analyses/trajectory/{experiment}.safetensors")
TRUE = (None, "told", "learned", "held_out")  #: How an answer is true to a session; none: not true.
TOLD, LEARNED, HELD_OUT = 1, 2, 3
HIDDEN = {"tail": (TAIL, HEAD), "head": (HEAD, TAIL)}  #: By hidden slot: columns of the hidden and of the given entity.
#: One row per entity. ``told``: number of its insert triples. ``shown``: share of the known entities' variance on the
#: two axes of its map. ``fitted``: share of the variance in Θ⁰ that the joint model explains (``procrustes``).
SINGLE_INSERTIONS = Table(
    "data/analyses/explorer/{experiment}.parquet",
    {"entity": ENTITY, "seed": FROM_0, "told": FROM_0, "shown": SHARE, "fitted": SHARE},
    key=["entity"], ordered=True,
)  # fmt: skip
#: Indicators of each entity with their weights; ``fallback``: of the initializer that it fell back to. ``by_words``:
#: cosine of word vectors; ``by_relations``: mean of cos(v_e, ᾱ_r) over the relations of the insert triples.
SINGLE_INDICATORS = Table(
    "data/analyses/explorer/{experiment}.indicators.parquet",
    {"entity": ENTITY, "model": NAME, "fallback": one_of(*FALLBACK_NAMES).optional, "indicator": ENTITY,
     "weight": SHARE, "by_words": within(-1, 1).optional, "by_relations": within(-1, 1).optional},
    key=["entity", "model", "indicator"],
)  # fmt: skip
#: Places on the map of a seed: the known entities in Θ⁰, others in a model after an epoch.
SINGLE_PLACES = Table(
    "data/analyses/explorer/{experiment}.places.parquet",
    {"seed": FROM_0, "entity": ENTITY, "model": NAME, "epoch": FROM_0, "x": REAL, "y": REAL},
    key=["seed", "entity", "model", "epoch"],
)
#: The first answers to (entity, relation, ?) and (?, relation, entity), and the true ones, ranked among all entities
#: of the session. ``true``: in which way an answer is true; null: it is not.
SINGLE_ANSWERS = Table(
    "data/analyses/explorer/{experiment}.answers.parquet",
    {"entity": ENTITY, "model": NAME, "epoch": FROM_0, "relation": NAME, "hidden": one_of(*HIDDEN), "answer": ENTITY,
     "rank": FROM_1, "true": one_of(*TRUE[1:]).optional},
    key=["entity", "model", "epoch", "relation", "hidden", "answer"],
    checks=[unique("entity", "model", "epoch", "relation", "hidden", "rank")],
)  # fmt: skip

#: The paper's initializers whose path is traced, and those that are shown beside the one that params name.
TRACED, SHOWN = ("xavier", "iu", "es", "rs", "ers"), ("xavier", "es", "rs", "ers")
THETA0 = "theta0"  #: What a map shows of the known entities.
#: Each table by name, and what it is sorted by.
TABLES = {
    "entities": (SINGLE_INSERTIONS, "entity"), "indicators": (SINGLE_INDICATORS, "entity"),
    "places": (SINGLE_PLACES, "seed"), "answers": (SINGLE_ANSWERS, "entity"),
}  # fmt: skip


class Trajectories(Study):
    """``trajectory`` in params: which novel set is traced, and for how many epochs."""

    size: Count
    seed: Seed
    kind: str
    epochs: Count


class ExplorerParams(Study):
    """``explorer`` in params: which insertions are shown, and how much of each."""

    size: Count
    epochs: Count
    best: Name  #: the initializer that is shown beside ``SHOWN``
    indicators: Count  #: of a centre, at most
    answers: Count  #: of a query, beside those that are true


def trace_trajectory(
    points: GridPoints, theta: Embedding, words: np.ndarray, config: InsertConfig, place: int
) -> tuple[np.ndarray, np.ndarray]:
    """The vector of a novel entity before training and after each epoch, (epochs + 1, d), and its indicators, (E,)."""
    novel, initial, path = points.novel_in(1), initialize(points, theta, words, config), list[Tensor]()

    def watch(epoch: int, embedding: Embedding, models: Tensor) -> Tensor:
        path.append(embedding.entity[0, novel[0, place]].clone() if epoch else initial.vectors[0, place])
        return never_stop(epoch, embedding, models)

    finetune(points, with_vectors(theta, novel, initial.vectors), config, watch)
    none = torch.zeros(len(points.graph.entities), dtype=torch.bool)
    indicators = none if initial.indicators is None else initial.indicators[0, place]
    return torch.stack(path).cpu().numpy(), indicators.cpu().numpy()


def place_of_traced(
    points: GridPoints, theta0: Embedding, words: np.ndarray, kinds: pd.Series, kind: str
) -> int | None:
    """Place in the set of the first novel entity of a kind with a word vector and insert triples; null if none has."""
    context = init_context(points, theta0, words, 0)
    able = (similarity.has_words(context) & similarity.has_insert_triples(context))[0].numpy()
    places = np.flatnonzero(able & (kinds.astype(str)[points.novel[0, 0]] == kind).to_numpy())
    return int(places[0]) if len(places) else None


@dataclass(frozen=True)
class Plane:
    """The two principal axes of vectors."""

    centre: Tensor  #: shape: (d,)
    axes: Tensor  #: shape: (2, d)
    share: float  #: of the vectors' variance that is on them

    @classmethod
    def of(cls, vectors: Tensor) -> Plane:
        """The principal plane of vectors, (N, d); the largest coordinate of each axis is positive."""
        vectors = vectors.double()
        centre = vectors.mean(0)
        _, lengths, axes = torch.linalg.svd(vectors - centre, full_matrices=False)
        largest = axes[:2].gather(1, axes[:2].abs().argmax(1, keepdim=True))
        return cls(centre, axes[:2] * largest.sign(), float(lengths[:2].square().sum() / lengths.square().sum()))

    def project(self, vectors: Tensor) -> Tensor:
        """Project vectors, (..., d), onto the plane; shape (..., 2)."""
        return (vectors.double() - self.centre) @ self.axes.T


def procrustes(vectors: Tensor, onto: Tensor, known: Tensor) -> tuple[Tensor, Tensor]:
    """Procrustes fit (rotation, scale, shift) of (M, E, d) vectors over known ones; explained variance, (M,)."""
    moved, shares = [], []
    for model, target, mask in zip(vectors.double(), onto.double(), known, strict=True):
        centre, target_centre = model[mask].mean(0), target[mask].mean(0)
        offsets, target_offsets = model[mask] - centre, target[mask] - target_centre
        left, lengths, right = torch.linalg.svd(offsets.T @ target_offsets)
        scale = lengths.sum() / offsets.square().sum()
        moved.append((model - centre) @ left @ right * scale + target_centre)
        shares.append(lengths.sum() * scale / target_offsets.square().sum())
    return torch.stack(moved), torch.stack(shares)


@dataclass(frozen=True)
class ShownEntities:
    """The novel entities that the explorer shows: model, place in ``novel``, id and seed; shapes (K,)."""

    model: Tensor
    place: Tensor
    entity: Tensor
    seed: Tensor

    @classmethod
    def of(cls, points: GridPoints, seeds: Mapping[int, int]) -> ShownEntities:
        """The shown entities of session 1; ``seeds``: the seed in which each entity is shown."""
        novel, of_model = points.novel_in(1), torch.tensor(points.seeds)
        shown_in = torch.tensor([[seeds[entity] for entity in row] for row in novel.tolist()])
        model, place = (shown_in == of_model[:, None]).nonzero(as_tuple=True)
        return cls(model, place, novel[model, place], of_model[model])

    def pick(self, values: Tensor) -> Tensor:
        """Values of novel entities, (M, n, ...), restricted to these; shape (K, ...)."""
        return values[self.model, self.place]


def first_seeds(novel: pd.DataFrame, size: int) -> dict[int, int]:
    """For each entity, the first seed whose session 1 inserts it at this size (``NOVEL``)."""
    rows = novel[(novel["size"] == size) & (novel["session"] == 1)]
    return rows.groupby("entity")["seed"].min().to_dict()  # type: ignore[return-value]


def columns(**of: Any) -> pd.DataFrame:
    """A frame of columns, arrays or tensors."""
    return pd.DataFrame({name: c.cpu().numpy() if isinstance(c, Tensor) else c for name, c in of.items()})


def single_insertions(
    points: GridPoints, theta: Embedding, joint: Embedding, words: np.ndarray, configs: Sequence[InsertConfig],
    seeds: Mapping[int, int], settings: ExplorerParams,
) -> dict[str, pd.DataFrame]:  # fmt: skip
    """Indicators, positions and answers of the shown entities, for each initializer (``TABLES``)."""
    shown, known = ShownEntities.of(points, seeds), points.session(0).entities
    planes = [Plane.of(vectors[mask]) for vectors, mask in zip(theta.entity, known, strict=True)]
    turned, fitted = procrustes(joint.entity, theta.entity, known)
    steps, parts = [(JOINT_MODEL, 0, joint, turned)], {name: list[pd.DataFrame]() for name in TABLES}
    parts["places"].append(places_of_known(points, shown, theta.entity, planes))
    for config in configs:
        initial = initialize(points, theta, words, config)
        inserted = with_vectors(theta, points.novel_in(1), initial.vectors)
        trained = finetune(points, inserted, config, never_stop)
        steps += [(config.initializer, 0, inserted, inserted.entity)]
        steps += [(config.initializer, settings.epochs, trained, trained.entity)]
        if initial.weights is not None:
            rows = indicator_rows(init_context(points, theta, words, config.root), initial, initial.weights, shown)
            # most similar first, of equal weights
            similar = ["by_words", "by_relations"] if config.initializer == "es" else ["by_relations", "by_words"]
            rows = rows.sort_values(["weight", *similar], ascending=False, kind="stable")
            first = rows.groupby("entity", sort=False).head(settings.indicators).sort_values("entity", kind="stable")
            parts["indicators"].append(first.assign(model=config.initializer))
    queried, truth = queries_of(points, shown)
    for name, epoch, embedding, entity in steps:
        answers = first_answers(embedding, points, shown, queried, truth, settings.answers)
        pairs = zip(shown.model.tolist(), shown.entity.tolist(), strict=True)
        x, y = torch.stack([planes[model].project(entity[model, row]) for model, row in pairs]).T
        for table, rows in ("answers", answers), ("places", columns(entity=shown.entity, seed=shown.seed, x=x, y=y)):
            parts[table].append(rows.assign(model=name, epoch=epoch))
    n_triples, share = (truth == TOLD).sum((1, 2, 3)), [planes[model].share for model in shown.model.tolist()]
    entities = columns(entity=shown.entity, seed=shown.seed, told=n_triples, shown=share, fitted=fitted[shown.model])
    return {name: pd.concat(frames) for name, frames in (parts | {"entities": [entities]}).items()}


def indicator_rows(context: InitContext, initial: InitResult, weights: Tensor, shown: ShownEntities) -> pd.DataFrame:
    """A row for each indicator with a weight; weights of shape (M, n, E)."""
    k, indicator = (shown.pick(weights) > 0).nonzero(as_tuple=True)
    worded = similarity.has_words(context)[..., None] & similarity.word_eligible(context)
    observed = similarity.has_insert_triples(context)[..., None]
    numbers = {
        "weight": weights,
        "by_words": similarity.word_similarity(context).masked_fill(~worded, torch.nan),
        "by_relations": similarity.mean_relational_score(context).masked_fill(~observed, torch.nan),
    }
    return columns(
        entity=shown.entity[k], indicator=indicator,
        **{name: shown.pick(values)[k, indicator].double() for name, values in numbers.items()},
        fallback=np.array(FALLBACKS, dtype=object)[shown.pick(initial.fallback)[k].cpu().numpy()],
    )  # fmt: skip


def places_of_known(points: GridPoints, shown: ShownEntities, entity: Tensor, planes: Sequence[Plane]) -> pd.DataFrame:
    """Positions of the known entities in Θ⁰ of each seed that is shown (``SINGLE_PLACES``)."""
    known, parts = points.session(0).entities, []
    for model in sorted(set(shown.model.tolist())):
        x, y = planes[model].project(entity[model, known[model]]).T
        parts.append(columns(seed=points.seeds[model], entity=known[model].nonzero().flatten(), x=x, y=y))
    return pd.concat(parts).assign(model=THETA0, epoch=0)


def queries_of(points: GridPoints, shown: ShownEntities) -> tuple[Tensor, Tensor]:
    """Queries that fit each entity's kind, (K, R, 2), bool; index of each answer in ``TRUE``, (K, R, 2, E), int8."""
    graph, session = points.graph, points.session(1)
    code = torch.where(session.splits == TRAIN, torch.where(points.insert_mask(1), TOLD, LEARNED), HELD_OUT)
    code = code.masked_fill(session.splits == OUT, 0).to(torch.int8)
    shape = len(graph.relations), len(HIDDEN)
    takes = torch.zeros(int(graph.kinds.max()) + 1, *shape, dtype=torch.bool)
    truth = torch.zeros(len(shown.entity), *shape, len(graph.entities), dtype=torch.int8)
    relation = graph.triples[:, RELATION]
    for side, (hidden, given) in enumerate(HIDDEN.values()):
        takes[graph.kinds[graph.triples[:, given]], relation, side] = True
        k, triple = (graph.triples[:, given] == shown.entity[:, None]).nonzero(as_tuple=True)
        truth[k, relation[triple], side, graph.triples[triple, hidden]] = code[shown.model[k], triple]
    return takes[graph.kinds[shown.entity]], truth


def first_answers(
    embedding: Embedding, points: GridPoints, shown: ShownEntities, queried: Tensor, truth: Tensor, first: int
) -> pd.DataFrame:
    """The ``first`` best answers to ``queried``, (K, R, 2), and all of ``truth``, (K, R, 2, E), by rank; ties by id."""
    novel, pick = points.novel_in(1), shown.pick
    scores = torch.stack([
        torch.stack([pick(embedding.score_tails(novel, relation)), pick(embedding.score_heads(relation, novel))], 1)
        for relation in (torch.full_like(novel, number) for number in range(len(points.graph.relations)))
    ], 1)  # fmt: skip
    barred = ~points.session(1).entities[shown.model][:, None, None]
    order = scores.masked_fill(barred, -torch.inf).sort(dim=-1, descending=True, stable=True).indices
    listed = queried[..., None] & ~barred & ((order.argsort(-1) < first) | (truth > 0))
    k, relation, side, place = listed.gather(-1, order).nonzero(as_tuple=True)
    answer = order[k, relation, side, place]
    return columns(
        entity=shown.entity[k], relation=np.array(points.graph.relations)[relation.cpu().numpy()],
        hidden=np.array(list(HIDDEN))[side.cpu().numpy()], answer=answer, rank=place + 1,
        true=np.array(TRUE, dtype=object)[truth[k, relation, side, answer].cpu().numpy()],
    )  # fmt: skip
