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

#: Shapes: entity (1,), known (E,), theta0 (E, d); of each initializer: NAME.path (epochs + 1, d), NAME.indicators (E,).
TRAJECTORY = TensorFile("data/analyses/trajectory/{experiment}.safetensors")
TRUE = (None, "told", "learned", "held_out")  #: An answer: false, insert triple, other training triple, held out.
TOLD, LEARNED, HELD_OUT = 1, 2, 3
HIDDEN = {"tail": (TAIL, HEAD), "head": (HEAD, TAIL)}  #: By hidden slot: columns of the hidden and of the given entity.
#: One row per entity. ``told``: number of its insert triples. ``shown``: share of the known entities' variance on the
#: two axes of its map. ``fitted``: share of the variance in Θ⁰ that the joint model explains (``procrustes``).
SINGLE_INSERTIONS = Table(
    "data/analyses/explorer/{experiment}.parquet",
    {"entity": ENTITY, "seed": FROM_0, "told": FROM_0, "shown": SHARE, "fitted": SHARE},
    key=["entity"], ordered=True,
)  # fmt: skip
#: Indicators of each entity with their weights. ``fallback``: the initializer that was used instead. ``by_words``:
#: cosine of word vectors. ``by_relations``: mean of cos(v_e, ᾱ_r) over the relations of the insert triples.
SINGLE_INDICATORS = Table(
    "data/analyses/explorer/{experiment}.indicators.parquet",
    {"entity": ENTITY, "model": NAME, "fallback": one_of(*FALLBACK_NAMES).optional, "indicator": ENTITY,
     "weight": SHARE, "by_words": within(-1, 1).optional, "by_relations": within(-1, 1).optional},
    key=["entity", "model", "indicator"],
)  # fmt: skip
#: Positions on the map of a seed: known entities in Θ⁰ (epoch 0), novel ones in ``model`` after ``epoch``.
SINGLE_PLACES = Table(
    "data/analyses/explorer/{experiment}.places.parquet",
    {"seed": FROM_0, "entity": ENTITY, "model": NAME, "epoch": FROM_0, "x": REAL, "y": REAL},
    key=["seed", "entity", "model", "epoch"],
)
#: The best answers to (entity, relation, ?) and (?, relation, entity), and all true ones, ranked among all entities
#: of the session. ``true``: a value of ``TRUE``; null: a false answer.
SINGLE_ANSWERS = Table(
    "data/analyses/explorer/{experiment}.answers.parquet",
    {"entity": ENTITY, "model": NAME, "epoch": FROM_0, "relation": NAME, "hidden": one_of(*HIDDEN), "answer": ENTITY,
     "rank": FROM_1, "true": one_of(*TRUE[1:]).optional},
    key=["entity", "model", "epoch", "relation", "hidden", "answer"],
    checks=[unique("entity", "model", "epoch", "relation", "hidden", "rank")],
)  # fmt: skip

#: Initializers whose path Figure 1 shows, and those that the explorer shows in addition to ``explorer.best`` of params.
TRACED, SHOWN = ("xavier", "iu", "es", "rs", "ers"), ("xavier", "es", "rs", "ers")
THETA0 = "theta0"  #: ``model`` of known entities in ``SINGLE_PLACES``.
#: By name: a table of the explorer, and the column that its rows are sorted by.
TABLES = {
    "entities": (SINGLE_INSERTIONS, "entity"), "indicators": (SINGLE_INDICATORS, "entity"),
    "places": (SINGLE_PLACES, "seed"), "answers": (SINGLE_ANSWERS, "entity"),
}  # fmt: skip


class Trajectories(Study):
    """``trajectory`` in params: |ξ| and seed of the novel set, kind of the traced entity, epochs of fine-tuning."""

    size: Count
    seed: Seed
    kind: str
    epochs: Count


class ExplorerParams(Study):
    """``explorer`` in params: |ξ| and epochs of the insertions shown, and limits of their lists."""

    size: Count
    epochs: Count
    best: Name  #: the initializer that is shown in addition to ``SHOWN``
    indicators: Count  #: maximum number per entity and initializer
    answers: Count  #: number of best answers per query; true answers are listed in any case


def trace_trajectory(
    points: GridPoints, theta: Embedding, words: np.ndarray, config: InsertConfig, place: int
) -> tuple[np.ndarray, np.ndarray]:
    """Vectors of the novel entity at ``place`` at epochs 0, 1, ..., (epochs + 1, d), and its indicators, (E,) bool."""
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
    """Index in ``novel`` of the first entity of ``kind`` with a word vector and insert triples, or None."""
    context = init_context(points, theta0, words, 0)
    able = (similarity.has_words(context) & similarity.has_insert_triples(context))[0].numpy()
    places = np.flatnonzero(able & (kinds.astype(str)[points.novel[0, 0]] == kind).to_numpy())
    return int(places[0]) if len(places) else None


@dataclass(frozen=True)
class Plane:
    """The plane of the two principal axes of vectors."""

    centre: Tensor  #: shape: (d,)
    axes: Tensor  #: shape: (2, d)
    share: float  #: share of the vectors' variance in the plane

    @classmethod
    def of(cls, vectors: Tensor) -> Plane:
        """The principal plane of vectors, (N, d); the coordinate of largest magnitude of each axis is positive."""
        vectors = vectors.double()
        centre = vectors.mean(0)
        _, lengths, axes = torch.linalg.svd(vectors - centre, full_matrices=False)
        largest = axes[:2].gather(1, axes[:2].abs().argmax(1, keepdim=True))
        return cls(centre, axes[:2] * largest.sign(), float(lengths[:2].square().sum() / lengths.square().sum()))

    def project(self, vectors: Tensor) -> Tensor:
        """Project vectors, (..., d), onto the plane; shape (..., 2)."""
        return (vectors.double() - self.centre) @ self.axes.T


def procrustes(vectors: Tensor, onto: Tensor, known: Tensor) -> tuple[Tensor, Tensor]:
    """Rotate, scale and shift ``vectors`` (M, E, d) to fit ``onto`` at known rows; explained share of variance (M,)."""
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
    """The novel entities that the explorer shows: index of the model, index in its novel set, id, seed; shapes (K,)."""

    model: Tensor
    place: Tensor
    entity: Tensor
    seed: Tensor

    @classmethod
    def of(cls, points: GridPoints, seeds: Mapping[int, int]) -> ShownEntities:
        """The shown entities of session 1; ``seeds``: for each entity, the seed in which it is shown."""
        novel, of_model = points.novel_in(1), torch.tensor(points.seeds)
        shown_in = torch.tensor([[seeds[entity] for entity in row] for row in novel.tolist()])
        model, place = (shown_in == of_model[:, None]).nonzero(as_tuple=True)
        return cls(model, place, novel[model, place], of_model[model])

    def pick(self, values: Tensor) -> Tensor:
        """Select the values of the shown entities from those of all novel entities, (M, n, ...); shape (K, ...)."""
        return values[self.model, self.place]


def first_seeds(novel: pd.DataFrame, size: int) -> dict[int, int]:
    """For each entity, the first seed whose session 1 inserts it at ``size``; ``novel``: rows of ``NOVEL``."""
    rows = novel[(novel["size"] == size) & (novel["session"] == 1)]
    return rows.groupby("entity")["seed"].min().to_dict()  # type: ignore[return-value]


def columns(**of: Any) -> pd.DataFrame:
    """A data frame of named columns, each an array or a tensor."""
    return pd.DataFrame({name: c.cpu().numpy() if isinstance(c, Tensor) else c for name, c in of.items()})


def single_insertions(
    points: GridPoints, theta: Embedding, joint: Embedding, words: np.ndarray, configs: Sequence[InsertConfig],
    seeds: Mapping[int, int], settings: ExplorerParams,
) -> dict[str, pd.DataFrame]:  # fmt: skip
    """Rows of each table in ``TABLES`` for the shown entities of a stack, for the joint model and all initializers."""
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
            # largest weight first; among equal weights, the most similar first
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
    """Rows of ``SINGLE_INDICATORS`` without ``model``: the entities with positive weights; weights: (M, n, E)."""
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
    """Rows of ``SINGLE_PLACES``: positions of the known entities in Θ⁰, for each seed of a shown entity."""
    known, parts = points.session(0).entities, []
    for model in sorted(set(shown.model.tolist())):
        x, y = planes[model].project(entity[model, known[model]]).T
        parts.append(columns(seed=points.seeds[model], entity=known[model].nonzero().flatten(), x=x, y=y))
    return pd.concat(parts).assign(model=THETA0, epoch=0)


def queries_of(points: GridPoints, shown: ShownEntities) -> tuple[Tensor, Tensor]:
    """Whether any triple has the entity's kind at its given end, (K, R, 2); answers' indices in ``TRUE``, (..., E)."""
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
    """Rows of the ``first`` best and of all true answers to ``queried`` (K, R, 2); tied scores: lower id first."""
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
