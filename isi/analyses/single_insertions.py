"""Single insertions, entity by entity: what indicates each, where it is put, and what models answer about it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd
import torch
from torch import Tensor

from isi.analyses.trajectory import Plane, turn
from isi.config import Count, Name, Study
from isi.experiment.grid import JOINT_MODEL, GridPoints, StackedVectors
from isi.experiment.insert import InsertConfig, finetune, init_context, initialize, with_vectors
from isi.experiment.store import FALLBACK_NAMES
from isi.graph.graph import HEAD, RELATION, TAIL
from isi.graph.sessions import OUT, TRAIN
from isi.initializers import similarity
from isi.initializers.api import FALLBACKS, InitContext, InitResult
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
#: Each table by name, and what it is sorted by.
TABLES = {
    "entities": (SINGLE_INSERTIONS, "entity"), "indicators": (SINGLE_INDICATORS, "entity"),
    "places": (SINGLE_PLACES, "seed"), "answers": (SINGLE_ANSWERS, "entity"),
}  # fmt: skip
#: Columns of triples with the end that a query hides, and with the one that it gives.
HIDDEN = {"tail": (TAIL, HEAD), "head": (HEAD, TAIL)}
#: What a true answer is to a session; none: not true.
TRUE = (None, *TRUE_NAMES)
TOLD, LEARNED, HELD_OUT = 1, 2, 3


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
class ShownEntities:
    """The novel entities of a stack that are shown: their model, place in ``novel``, and id; shapes (K,)."""

    model: Tensor
    place: Tensor
    entity: Tensor
    #: of the models
    seeds: np.ndarray

    @classmethod
    def of(cls, points: GridPoints, seeds: Mapping[int, int]) -> ShownEntities:
        """Those of the first session; ``seeds``: in which each entity is shown."""
        novel = points.novel_in(1)
        shown = torch.tensor([[seeds[entity] == seed for entity in row]
                              for row, seed in zip(novel.tolist(), points.seeds, strict=True)])  # fmt: skip
        model, place = shown.nonzero(as_tuple=True)
        return cls(model, place, novel[model, place], np.array(points.seeds)[model.cpu().numpy()])

    def pick(self, values: Tensor) -> Tensor:
        """Values of novel entities, (M, n, ...), of those alone; shape (K, ...)."""
        return values[self.model, self.place]


def first_seeds(novel: pd.DataFrame, size: int) -> dict[int, int]:
    """The first seed in which the first session of a size inserts each entity (``NOVEL``)."""
    rows = novel[(novel["size"] == size) & (novel["session"] == 1)].sort_values("seed", kind="stable")
    firsts = rows.drop_duplicates("entity")
    return dict(zip(firsts["entity"].tolist(), firsts["seed"].tolist(), strict=True))


def single_insertions(
    points: GridPoints, theta0: StackedVectors, joint: StackedVectors, words: np.ndarray,
    configs: Sequence[InsertConfig], seeds: Mapping[int, int], settings: ExplorerParams,
) -> dict[str, pd.DataFrame]:  # fmt: skip
    """Indicators, places and answers of the novel entities that are shown: each of ``TABLES``.

    Args:
        configs: of each initializer.
        seeds: in which each entity is shown.
    """
    theta, shown, known = theta0.stack, ShownEntities.of(points, seeds), points.session(0).entities
    queries = EntityQueries.of(points, shown)
    planes = [Plane.of(vectors[mask]) for vectors, mask in zip(theta.entity, known, strict=True)]
    turned, fitted = turn(joint.stack.entity, theta.entity, known)
    steps = [(JOINT_MODEL, 0, joint.stack, turned)]
    indicators, places = list[pd.DataFrame](), [known_places(points, shown, theta.entity, planes)]
    for config in configs:
        initial = initialize(points, theta, words, config)
        inserted = with_vectors(theta, points.novel_in(1), initial.vectors)
        trained = finetune(points, inserted, config, never_stop)
        steps += [(config.initializer, 0, inserted, inserted.entity)]
        steps += [(config.initializer, settings.epochs, trained, trained.entity)]
        if initial.weights is not None:
            rows = indicator_rows(init_context(points, theta, words, config.root), initial, initial.weights, shown)
            indicators.append(first_rows(rows, config.initializer, settings.indicators))
    places += [novel_places(shown, entity, planes).assign(model=name, epoch=epoch) for name, epoch, _, entity in steps]
    answers = [
        queries.answers(embedding, points, settings.answers).assign(model=name, epoch=epoch)
        for name, epoch, embedding, _ in steps
    ]
    entities = pd.DataFrame({
        "entity": shown.entity.cpu().numpy(), "seed": shown.seeds,
        "told": (queries.truth == TOLD).sum((1, 2, 3)).cpu().numpy(),
        "shown": [planes[model].share for model in shown.model.tolist()], "fitted": fitted[shown.model].cpu().numpy(),
    })  # fmt: skip
    parts = {"indicators": indicators, "places": places, "answers": answers}
    return {"entities": entities, **{name: pd.concat(frames) for name, frames in parts.items()}}


def indicator_rows(context: InitContext, initial: InitResult, weights: Tensor, shown: ShownEntities) -> pd.DataFrame:
    """Every entity that has a weight in the centre of a vector; weights of shape (M, n, E)."""
    k, indicator = (shown.pick(weights) > 0).nonzero(as_tuple=True)
    without_word = ~(similarity.has_words(context)[..., None] & similarity.word_eligible(context))
    columns = {
        "weight": weights,
        "by_words": similarity.word_similarity(context).masked_fill(without_word, torch.nan),
        "by_relations": similarity.mean_relational_score(context).masked_fill(
            ~similarity.has_insert_triples(context)[..., None], torch.nan
        ),
    }
    return pd.DataFrame({
        "entity": shown.entity[k].cpu().numpy(), "indicator": indicator.cpu().numpy(),
        **{name: shown.pick(values)[k, indicator].double().cpu().numpy() for name, values in columns.items()},
        "fallback": np.array(FALLBACKS, dtype=object)[shown.pick(initial.fallback)[k].cpu().numpy()],
    })  # fmt: skip


def first_rows(rows: pd.DataFrame, model: str, most: int) -> pd.DataFrame:
    """The entities of largest weight in the centre of each vector (``SINGLE_INDICATORS``), most similar first."""
    similar = ["by_words", "by_relations"] if model == "es" else ["by_relations", "by_words"]
    rows = rows.sort_values(["weight", *similar], ascending=False, kind="stable")
    return rows.groupby("entity", sort=False).head(most).sort_values("entity", kind="stable").assign(model=model)


def novel_places(shown: ShownEntities, entity: Tensor, planes: Sequence[Plane]) -> pd.DataFrame:
    """Where tables of shape (M, E, d) have the novel entities (``SINGLE_PLACES``)."""
    pairs = zip(shown.model.tolist(), shown.entity.tolist(), strict=True)
    x, y = torch.stack([planes[model].project(entity[model, row]) for model, row in pairs]).T.cpu().numpy()
    return pd.DataFrame({"seed": shown.seeds, "entity": shown.entity.cpu().numpy(), "x": x, "y": y})


def known_places(points: GridPoints, shown: ShownEntities, entity: Tensor, planes: Sequence[Plane]) -> pd.DataFrame:
    """Where Θ⁰ has the known entities of each seed in which one is shown (``SINGLE_PLACES``)."""
    known, parts = points.session(0).entities, []
    for model in sorted(set(shown.model.tolist())):
        x, y = planes[model].project(entity[model, known[model]]).T.cpu().numpy()
        ids = known[model].nonzero().flatten().cpu().numpy()
        parts.append(pd.DataFrame({"seed": points.seeds[model], "entity": ids, "x": x, "y": y}))
    return pd.concat(parts).assign(model=THETA0, epoch=0)


@dataclass(frozen=True)
class EntityQueries:
    """Queries about the entities that are shown, (entity, relation, ?) and (?, relation, entity)."""

    shown: ShownEntities
    #: who may answer; shape: (K, E), bool
    candidates: Tensor
    #: which are queried, by relation and by what is hidden, in the order of ``HIDDEN``; shape: (K, R, 2), bool
    queried: Tensor
    #: what each answer is, an index into ``TRUE``; shape: (K, R, 2, E), int8
    truth: Tensor

    @classmethod
    def of(cls, points: GridPoints, shown: ShownEntities) -> EntityQueries:
        """The queries for the ends that entities of their kind are of triples."""
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
        return cls(shown, session.entities[shown.model], takes[graph.kinds[shown.entity]], truth)

    def answers(self, embedding: Embedding, points: GridPoints, first: int) -> pd.DataFrame:
        """The first answers to each query and the true ones, in order (``SINGLE_ANSWERS``); equal scores by id."""
        novel, pick = points.novel_in(1), self.shown.pick
        scores = torch.stack([
            torch.stack([pick(embedding.score_tails(novel, relation)), pick(embedding.score_heads(relation, novel))], 1)
            for relation in (torch.full_like(novel, number) for number in range(len(points.graph.relations)))
        ], 1)  # fmt: skip
        barred = ~self.candidates[:, None, None]
        order = scores.masked_fill(barred, -torch.inf).sort(dim=-1, descending=True, stable=True).indices
        rank = order.argsort(-1) + 1
        listed = self.queried[..., None] & ~barred & ((rank <= first) | (self.truth > 0))
        k, relation, side, place = listed.gather(-1, order).nonzero(as_tuple=True)
        answer = order[k, relation, side, place]
        return pd.DataFrame({
            "entity": self.shown.entity[k].cpu().numpy(),
            "relation": np.array(points.graph.relations)[relation.cpu().numpy()],
            "hidden": np.array(list(HIDDEN))[side.cpu().numpy()], "answer": answer.cpu().numpy(),
            "rank": place.cpu().numpy() + 1,
            "true": np.array(TRUE, dtype=object)[self.truth[k, relation, side, answer].cpu().numpy()],
        })  # fmt: skip
