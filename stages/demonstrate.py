"""Compute what the page's picture and explorer show: Θ⁰ of one seed, and insertions into it."""

from __future__ import annotations

import base64
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import torch

from isi.initializers.api import INITIALIZERS
from isi.initializers.context import InitContext, context_in_session
from isi.initializers.similarity import cosines
from isi.models.bilinear import BlockModel
from isi.models.model import Model
from isi.models.stack import Embedding
from isi.tables.io import atomically, keep_only
from isi.tables.table import DataFile
from stages.grid import GridPoints, NovelSet
from stages.make_sessions import Shares, sample_insert_triples
from stages.projection import Projection, ticks
from stages.stage import StageContext, stage
from stages.store import Store, model_of

DEMONSTRATION = DataFile("data/analyses/demonstration/{experiment}.json")
#: The initializers that the page computes itself.
COMPUTED = ("mean", "xavier", "iu", "es", "rs", "ers")
#: The initializers of the picture: one that needs the name of the new entity alone, and a random
#: one.
SHOWN, RANDOM = "es", "xavier"
#: Random starts, of which the one with the median answers is shown.
DRAWS = 50
FIRST = "bottle"  #: The new entity that is shown first, if it is one.
#: Coordinates of the joint model are rounded to this many steps from zero to the largest.
STEPS = 2**15 - 1
QUESTIONS = 2  #: Number of questions in the picture.
ANSWERS = 4  #: Number of first answers to each question.
NEXT = 2  #: Number of names that are listed though they are less alike.

Options = Mapping[str, Mapping[str, Any]]  #: Of initializers, by name.
Question = tuple[int, bool]  #: A relation, and whether the new entity is its tail.


@stage
def demonstrate(context: StageContext) -> None:
    params, shown = context.params, dict[Path, str]()
    chosen: NovelSet = params.read("explorer", NovelSet)
    options: Options = params.read("initializers", dict[str, dict[str, Any]])
    fraction: float = params.read("sessions", Shares).insert_fraction
    for experiment in chosen.experiments:
        store = Store(experiment)
        explored = Explored.read(store, model_of(params), chosen.size, chosen.seed)
        kinds = store.entities()["kind"]
        content = demonstrated(explored, kinds, options, params.seed, fraction)
        path = DEMONSTRATION.path(experiment=experiment)
        shown[path] = json.dumps(content, ensure_ascii=False, allow_nan=False)
    folder = DEMONSTRATION.path(experiment="").parent
    folder.mkdir(parents=True, exist_ok=True)  # DVC expects it, even without experiments
    keep_only(folder, list(shown))
    for path, text in shown.items():
        atomically(path, partial(Path.write_bytes, data=text.encode()))


@dataclass(frozen=True, eq=False)
class Explored:
    """Θ⁰ and the joint model of one seed, with the word vectors of the graph's entities."""

    points: GridPoints  #: of one seed
    theta0: Embedding
    joint: Embedding
    words: np.ndarray  #: shape: (E, w)

    @classmethod
    def read(cls, store: Store, model: Model, size: int, seed: int) -> Explored | None:
        """Read the Θ⁰ of the novel set of a size |ξ| and a seed;
        None if its model is none that the page computes.
        """
        if not (isinstance(model, BlockModel) and model.linear):
            return None
        points = store.grid(1, size, seed + 1)[-1]
        theta0, joint = store.theta0(points, model), store.joint(points, model)[0]
        return cls(points, theta0, joint, store.words())

    @property
    def known(self) -> np.ndarray:
        """Mask of the entities of D⁰; shape (E,), bool."""
        return self.points.session(0).entities[0].numpy()

    @property
    def novel(self) -> list[int]:
        """The new entities, ascending."""
        return sorted(map(int, self.points.novel[0]))

    @property
    def first(self) -> int:
        """The new entity that is shown first."""
        names = self.points.graph.entities
        return next((entity for entity in self.novel if names[entity] == FIRST), self.novel[0])

    @property
    def vectors(self) -> np.ndarray:
        """Θ⁰; shape (E, d), float64."""
        return self.theta0.entity[0].double().numpy()

    @property
    def projection(self) -> Projection:
        return Projection.of(self.vectors[self.known])

    @property
    def triples(self) -> list[tuple[int, int, int, int]]:
        """Head, relation, tail and count of the triples of this seed."""
        graph, inside = self.points.graph, self.points.splits[0] >= 0
        return [tuple(row) for row in np.c_[graph.triples, graph.counts][inside].tolist()]

    def context(self, entity: int) -> InitContext:
        """What an initializer sees of a new entity of which no fact is given."""
        return context_in_session(
            self.theta0,
            self.points.session(0),
            torch.tensor([[entity]]),
            torch.empty(0, 3, dtype=torch.int64),
            torch.as_tensor(self.words),
            0,
            self.points.keys(),
        )

    def truth(self, entity: int) -> dict[Question, list[int]]:
        """The true known answers to each question about an entity, most observed first."""
        known, answers = self.known, dict[Question, list[tuple[int, int]]]()
        for head, relation, tail, count in self.triples:
            for end, other, is_tail in ((head, tail, False), (tail, head, True)):
                if end == entity and known[other]:
                    answers.setdefault((relation, is_tail), []).append((-count, other))
        return {of: [answer for _, answer in sorted(answers[of])] for of in sorted(answers)}

    def candidates(self, question: Question) -> set[int]:
        """The known entities that known triples have at the end which a question asks for."""
        (asked, is_tail), known = question, self.known
        return {
            head if is_tail else tail
            for head, relation, tail, _ in self.triples
            if relation == asked and known[head] and known[tail]
        }

    def ranked(
        self, entity: int, vector: np.ndarray, truth: Mapping[Question, Sequence[int]]
    ) -> dict[Question, list[int]]:
        """Candidates and true answers, best first, by question;
        ``vector``: of the entity, (d,).
        """
        table = self.theta0.entity.clone()
        table[0, entity] = torch.as_tensor(vector)
        inserted, asking = replace(self.theta0, entity=table), torch.tensor([[entity]])
        ranked = {}
        for question, answers in truth.items():
            relation, is_tail = torch.tensor([[question[0]]]), question[1]
            scores = (
                inserted.score_heads(relation, asking)
                if is_tail
                else inserted.score_tails(asking, relation)
            )[0, 0].tolist()
            answered = self.candidates(question) | set(answers)
            ranked[question] = sorted(answered, key=[-score for score in scores].__getitem__)
        return ranked


def demonstrated(
    explored: Explored | None, kinds: pd.Series, options: Options, root: int, fraction: float
) -> dict[str, Any]:
    """What the page shows of an experiment: ``explorer`` and ``picture``, of which any may be None;
    arguments: those of ``payload``.
    """
    if explored is None:
        return {"explorer": None, "picture": None}
    return {
        "explorer": payload(explored, kinds, options, root, fraction),
        "picture": picture(explored, options),
    }


def draws(explored: Explored) -> np.ndarray:
    """Vectors of ``RANDOM``; shape: (``DRAWS``, d)."""
    initialize, context = INITIALIZERS.get(RANDOM).initialize, explored.context(explored.first)
    keyed = (replace(context, entity_keys=torch.tensor([[draw]])) for draw in range(DRAWS))
    return np.stack([initialize(each, {}).vectors[0, 0].numpy() for each in keyed])


def median_draw(explored: Explored, entity: int, drawn: np.ndarray) -> np.ndarray:
    """The draw with the median of the mean reciprocal ranks of true answers, (d,);
    of an even number the lower one.
    """
    truth = explored.truth(entity)
    qualities = []
    for vector in drawn:
        ranked = explored.ranked(entity, vector, truth)
        places = [ranked[of].index(each) for of, answers in truth.items() for each in answers]
        qualities.append(float(np.mean([1 / (place + 1) for place in places])) if places else 0.0)
    order = np.argsort(qualities, kind="stable")
    median: np.ndarray = drawn[order[(len(drawn) - 1) // 2]]
    return median


def payload(
    explored: Explored, kinds: pd.Series, options: Options, root: int, fraction: float
) -> dict[str, Any]:
    """The explorer's data as JSON values; arrays are base64 of little-endian numbers
    (see ``explorer/data.js``).

    Args:
        kinds: of all entities.
        root: root seed of the random streams.
        fraction: share of the training triples of an entity that are given.
    """
    points, theta0, model = explored.points, explored.theta0, explored.theta0.model
    assert isinstance(model, BlockModel)  # noqa: S101  # no other is read
    graph, known, vectors = points.graph, explored.known, explored.vectors
    of_kinds, names = pd.factorize(kinds.astype(str), sort=True)
    projection = explored.projection
    upper = cosines(torch.as_tensor(explored.words))[np.triu_indices(len(known))]
    drawn = draws(explored)
    return {
        "size": points.size,
        "seed": points.seeds[0],
        "model": type(model).__name__,
        "scalars": vectors.shape[1] * model.scalars // 100,
        "dimension": vectors.shape[1],
        "names": graph.entities,
        "kinds": list(names),
        "kind": of_kinds.tolist(),
        "relations": graph.relations,
        "known": np.flatnonzero(known).tolist(),
        "novel": explored.novel,
        "start": explored.first,
        "theta0": packed(vectors[known]),
        "map": packed(model.maps(theta0.relation[0])),
        "cosines": packed(upper),
        "worded": np.flatnonzero((explored.words != 0).any(1)).tolist(),
        "triples": np.c_[graph.triples, graph.counts, points.splits[0]].tolist(),
        "given": insert_triples(points, root, fraction),
        "random": {
            str(entity): packed(median_draw(explored, entity, drawn)) for entity in explored.novel
        },
        **joint_payload(explored, model),
        "projection": packed(np.stack([projection.centre, projection.axis])),
        "share": round(100 * projection.share),
        "initializers": [
            {"name": name, "label": INITIALIZERS.get(name).label, "options": options[name]}
            for name in COMPUTED
            if name in options
        ],
    }


def joint_payload(explored: Explored, model: BlockModel) -> dict[str, Any]:
    """The explorer's data of the joint model: its tables, and its places on the map once it is
    turned onto Θ⁰.
    """
    joint = explored.joint.entity[0].double().numpy()
    turned, fitted = procrustes(joint, explored.vectors, explored.known)
    scale = max(float(np.abs(joint).max()), 1e-9) / STEPS
    return {
        "joint": packed(np.round(joint / scale), "<i2"),
        "jointScale": scale,
        "jointMap": packed(model.maps(explored.joint.relation[0])),
        "jointPlaces": explored.projection.places(turned).round(3).tolist(),
        "fitted": round(100 * fitted),
    }


def packed(values: Any, kind: str = "<f4") -> str:
    """Numbers as base64, in single precision or another kind."""
    return base64.b64encode(np.ascontiguousarray(values, kind).tobytes()).decode()


def insert_triples(points: GridPoints, root: int, fraction: float) -> dict[str, list[int]]:
    """Insert triples by entity: of novel ones those of the run,
    of known ones drawn by the same rule.
    """
    session, rows = points.session(0), points.insert_triples
    splits, seed = session.splits[0].numpy(), points.seeds[0]
    triples = {
        int(entity): rows[rows[:, 1] == place, 2].tolist()
        for place, entity in enumerate(points.novel[0])
    }
    for entity in np.flatnonzero(session.entities[0]):
        alone = np.array([entity])
        drawn = sample_insert_triples(points.graph, splits, alone, root, seed, fraction)
        triples[int(entity)] = [triple for _, triple in drawn]
    return {str(entity): of_entity for entity, of_entity in sorted(triples.items())}


def procrustes(
    vectors: np.ndarray, onto: np.ndarray, known: np.ndarray
) -> tuple[np.ndarray, float]:
    """Rotate, scale and shift ``vectors`` (E, d) to fit ``onto`` at known rows;
    explained share of its variance.
    """
    centre, target = vectors[known].mean(0), onto[known].mean(0)
    offsets, target_offsets = vectors[known] - centre, onto[known] - target
    left, lengths, right = np.linalg.svd(offsets.T @ target_offsets)
    scale = lengths.sum() / (offsets**2).sum()
    return (vectors - centre) @ left @ right * scale + target, float(
        lengths.sum() * scale / (target_offsets**2).sum()
    )


def picture(explored: Explored, options: Options) -> dict[str, Any] | None:
    """One insertion by ``SHOWN`` beside a random start, as JSON values;
    None if the new entity has no word vector or no true answer.
    """
    entity, names = explored.first, explored.points.graph.entities
    tails = {of: answers for of, answers in explored.truth(entity).items() if not of[1]}
    if not ({SHOWN, RANDOM} <= options.keys() and tails and explored.words[entity].any()):
        return None
    most = sorted(tails, key=lambda of: (-len(tails[of]), of))[:QUESTIONS]
    truth = {of: tails[of] for of in sorted(most)}
    result = INITIALIZERS.get(SHOWN).initialize(explored.context(entity), options[SHOWN])
    assert result.indicators is not None  # noqa: S101  # its vectors are centroids
    indicators = np.flatnonzero(result.indicators[0, 0].numpy()).tolist()
    ours, random = (
        result.vectors[0, 0].numpy(),
        median_draw(explored, entity, draws(explored)),
    )
    answers = [explored.ranked(entity, vector, truth) for vector in (random, ours)]
    return {
        "name": names[entity],
        "alike": _alike(explored, entity, indicators),
        "map": _map(explored, indicators, ours, random),
        "questions": [
            {
                "relation": explored.points.graph.relations[of[0]],
                "random": _first(names, answers[0][of], truth[of]),
                "ours": _first(names, answers[1][of], truth[of]),
            }
            for of in truth
        ],
        "draws": DRAWS,
    }


def _first(names: Sequence[str], ranked: Sequence[int], true: Sequence[int]) -> list[list[Any]]:
    """The names of the first answers, and whether they are true."""
    return [[names[each], each in true] for each in ranked[:ANSWERS]]


def _alike(explored: Explored, entity: int, indicators: Sequence[int]) -> list[dict[str, Any]]:
    """Known names with the cosine of their word vectors with the new name's:
    the indicators, then the next ones.
    """
    alike = cosines(torch.as_tensor(explored.words))[entity].tolist()
    worded, trained = (explored.words != 0).any(1), explored.points.session(0).trained()[0].numpy()
    order = sorted(np.flatnonzero(trained & worded).tolist(), key=lambda each: -alike[each])
    chosen = [each for each in order if each in indicators]
    others = [each for each in order if each not in indicators]
    names = explored.points.graph.entities
    return [
        {"name": names[each], "cosine": alike[each], "chosen": each in indicators}
        for each in chosen + others[:NEXT]
    ]


def _map(
    explored: Explored, indicators: Sequence[int], ours: np.ndarray, random: np.ndarray
) -> dict[str, Any]:
    """Places on the projection of the known vectors: (distance from the centre, along the axis)."""
    projection, names = explored.projection, explored.points.graph.entities
    places = projection.places(explored.vectors).round(3)
    others = [each for each in np.flatnonzero(explored.known).tolist() if each not in indicators]
    highest = sorted(indicators, key=lambda each: -float(places[each, 1]))
    starts = projection.places(np.stack([ours, random])).round(3)
    drawn = np.concatenate([places[explored.known], starts])
    return {
        "known": places[others].tolist(),
        "indicators": [{"name": names[each], "at": places[each].tolist()} for each in highest],
        "ours": starts[0].tolist(),
        "random": starts[1].tolist(),
        "usual": float(places[explored.known, 0].mean().round(3)),
        "ticks": [ticks(0, drawn[:, 0].max()), ticks(drawn[:, 1].min(), drawn[:, 1].max())],
        "share": round(100 * projection.share),
    }


if __name__ == "__main__":
    demonstrate()
