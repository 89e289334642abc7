"""The picture that explains the method: one insertion of the run,
with its indicators and its first answers.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import torch

from isi.initializers.api import INITIALIZERS, InitContext
from isi.insertion.engine import context_in_session
from isi.report.explorer import Explored, starts_at
from isi.report.words import BASELINE, Names

#: The initializer that is shown: it needs the name of the new entity alone.
SHOWN = "es"
#: Random starts, of which the one with the median answers is shown.
DRAWS = 50
QUESTIONS = 2  #: Number of questions.
ANSWERS = 4  #: Number of first answers to each question.
_NEXT = 2  #: Number of names that are shown though they are less alike.

# Places in the drawings, in pixels.
_ROW = 27  #: Height of a row of names.
_BAR = 150  #: Width of a bar of cosine 1.
#: The map: its centre, and how far indicators and other known entities lie from it at most.
_CENTRE, _HALF, _MARGIN = np.array([166.0, 148.0]), np.array([80.0, 116.0]), np.array([6.0, 20.0])
_NEAR = 60  #: A point as near as this may hide the name of the new entity.
_GAP = 27  #: Between the names of indicators.


@dataclass(frozen=True)
class Question:
    """A relation of the new entity, and the first answers to it from both starts."""

    relation: str
    random: Sequence[tuple[str, bool]]  #: names, and whether they are true
    ours: Sequence[tuple[str, bool]]
    best: str  #: a true answer, and its ranks from both starts
    ranks: tuple[int, int]


@dataclass(frozen=True)
class Start:
    """A vector of the new entity, (d), and the ranked known entities by question."""

    vector: np.ndarray
    ranked: Mapping[int, list[int]]  #: ids of entities, best first, by id of relation

    def ranks(self, relation: int, answers: Sequence[int]) -> list[int]:
        """The ranks of answers, best 1."""
        return [self.ranked[relation].index(answer) + 1 for answer in answers]


def picture(explored: Explored, options: Mapping[str, Any]) -> dict[str, Any] | None:
    """What the template draws; None if the new entity has no word vector or no true answer.

    Args:
        explored: Θ⁰ of the run, without the new entity.
        options: of initializers, by name.
    """
    if SHOWN not in options or BASELINE not in options:
        return None
    points, entity = explored.points, starts_at(explored.points)
    truth = _truth(explored, entity)
    if not truth or not (explored.words[entity] != 0).any():
        return None
    context = context_in_session(
        explored.theta0,
        points.session(0),
        torch.tensor([[entity]]),
        torch.empty(0, 3, dtype=torch.int64),
        torch.as_tensor(explored.words),
        0,
        points.keys(),
    )
    result = INITIALIZERS.get(SHOWN, SHOWN).initialize(context, options[SHOWN])
    if result.indicators is None:
        return None
    indicators = np.flatnonzero(result.indicators[0, 0].numpy())
    ours = _start(explored, entity, result.vectors[0, 0].numpy(), truth)
    random = _median(explored, entity, context, truth)
    names = points.graph.entities
    return {
        "name": names[entity],
        "k": len(indicators),
        "alike": _alike(explored, entity, indicators, names),
        "map": _map(explored, indicators, ours.vector, random.vector, names),
        "questions": [_question(explored, of, truth[of], ours, random) for of in truth],
        "draws": DRAWS,
        "known": int(points.session(0).entities[0].sum()),
    }


def _truth(explored: Explored, entity: int) -> dict[int, list[int]]:
    """The known tails of an entity, most observed first, by relation;
    of the ``QUESTIONS`` relations with the most.
    """
    graph, known = explored.points.graph, explored.points.session(0).entities[0]
    tails = dict[int, list[tuple[int, int]]]()
    for (head, relation, tail), count in zip(
        graph.triples.tolist(), graph.counts.tolist(), strict=True
    ):
        if head == entity and known[tail]:
            tails.setdefault(relation, []).append((-count, tail))
    most = sorted(tails, key=lambda relation: (-len(tails[relation]), relation))[:QUESTIONS]
    return {of: [tail for _, tail in sorted(tails[of])] for of in sorted(most)}


def _start(
    explored: Explored, entity: int, vector: np.ndarray, truth: Mapping[int, Sequence[int]]
) -> Start:
    known = explored.points.session(0).entities[0].numpy()
    table = explored.theta0.entity.clone()
    table[0, entity] = torch.as_tensor(vector)
    inserted, ranked = replace(explored.theta0, entity=table), {}
    for relation in truth:
        scores = inserted.score_tails(torch.tensor([[entity]]), torch.tensor([[relation]]))
        order = (-scores[0, 0].numpy()).argsort(kind="stable")
        ranked[relation] = [int(other) for other in order if known[other]]
    return Start(vector, ranked)


def _median(
    explored: Explored, entity: int, context: InitContext, truth: Mapping[int, Sequence[int]]
) -> Start:
    """Of ``DRAWS`` random starts the one with the median of mean reciprocal ranks of true answers,
    of an even number the lower one.
    """
    starts = []
    for draw in range(DRAWS):
        drawn = replace(context, entity_keys=torch.tensor([[draw]]))
        vector = INITIALIZERS.get(BASELINE, BASELINE).initialize(drawn, {}).vectors[0, 0].numpy()
        start = _start(explored, entity, vector, truth)
        ranks = [rank for of, answers in truth.items() for rank in start.ranks(of, answers)]
        starts.append((float((1 / np.array(ranks)).mean()), draw, start))
    return sorted(starts, key=lambda start: start[:2])[(DRAWS - 1) // 2][2]


def _alike(
    explored: Explored, entity: int, indicators: np.ndarray, names: Names
) -> list[dict[str, Any]]:
    """Rows of known names with the cosine of their word vectors with the new name's."""
    of_words, known = explored.words.astype(np.float64), explored.points.session(0).trained()[0]
    lengths = np.linalg.norm(of_words, axis=1)
    cosines = of_words @ of_words[entity] / np.maximum(lengths * lengths[entity], 1e-12)
    order = [
        int(each) for each in (-cosines).argsort(kind="stable") if known[each] and lengths[each]
    ]
    chosen = [each for each in order if each in indicators]
    shown = chosen + [each for each in order if each not in indicators][:_NEXT]
    return [
        {
            "name": names[each],
            "cosine": float(cosines[each]),
            "chosen": each in indicators,
            "width": round(_BAR * max(float(cosines[each]), 0.01), 1),
            "top": place * _ROW,
        }
        for place, each in enumerate(shown)
    ]


def _map(
    explored: Explored, indicators: np.ndarray, ours: np.ndarray, random: np.ndarray, names: Names
) -> dict[str, Any]:
    """Places of known entities in the plane in which the indicators spread most, around their
    centre; distances from the centre are in all dimensions.
    """
    vectors = explored.theta0.entity[0].numpy().astype(np.float64)
    offsets = vectors - ours
    axes = np.linalg.svd(offsets[indicators], full_matrices=False)[2][:2]
    axes *= np.sign(axes[np.arange(len(axes)), np.abs(axes).argmax(1)])[:, None]
    flat = (offsets @ axes.T)[:, ::-1]  # the larger spread goes up
    flat = np.pad(flat, ((0, 0), (2 - flat.shape[1], 0)))
    scale = float((_HALF / np.maximum(np.abs(flat[indicators]).max(0), 1e-9)).min())
    places = np.round(_CENTRE + flat * scale, 1)
    known = explored.points.session(0).entities[0].numpy()
    inside = known & (np.abs(places - _CENTRE) <= _HALF + _MARGIN).all(1)
    others = [places[each].tolist() for each in np.flatnonzero(inside) if each not in indicators]
    order = sorted(indicators.tolist(), key=lambda each: float(places[each, 1]))
    heights = _CENTRE[1] + _GAP * (np.arange(len(order)) - (len(order) - 1) / 2)
    return {
        "dots": "".join(f"M{x:g} {y:g}h0" for x, y in others),
        "indicators": [
            {"name": names[each], "at": places[each].tolist(), "label": float(height)}
            for each, height in zip(order, heights, strict=True)
        ],
        "centre": _CENTRE.tolist(),
        "corner": _emptiest(places[indicators] - _CENTRE),
        "away": float(np.linalg.norm(random - ours)),
        "around": float(np.linalg.norm(offsets[known], axis=1).mean()),
    }


def _emptiest(offsets: np.ndarray) -> list[int]:
    """The signs of the corner around the centre in which the fewest points, (n, 2), are near."""
    near = offsets[np.abs(offsets).max(1) < _NEAR]
    corners = [[across, up] for up in (-1, 1) for across in (-1, 1)]
    return min(corners, key=lambda corner: int((near * corner > -4).all(1).sum()))


def _question(
    explored: Explored, relation: int, answers: Sequence[int], ours: Start, random: Start
) -> Question:
    names = explored.points.graph.entities

    def first(start: Start) -> list[tuple[str, bool]]:
        return [(names[each], each in answers) for each in start.ranked[relation][:ANSWERS]]

    nearest = min(answers, key=lambda answer: ours.ranks(relation, [answer])[0])
    (before,), (after,) = random.ranks(relation, [nearest]), ours.ranks(relation, [nearest])
    return Question(
        explored.points.graph.relations[relation],
        first(random),
        first(ours),
        names[nearest],
        (before, after),
    )
