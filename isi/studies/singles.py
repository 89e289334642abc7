"""Single insertions, entity by entity: who indicates each, where it is put, and what models answer about it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd
import torch
from torch import Tensor

from isi.base.params import Count, Name, Option, Section, Study
from isi.base.schemas import SINGLE_ANSWERS, SINGLE_INDICATORS, SINGLE_PLACES, SINGLES
from isi.embeddings.stack import Embedding
from isi.experiments.cells import Cells, Vectors
from isi.insertion.core import ES, FALLBACKS, NONE, RS, Initial, Insertion
from isi.insertion.similarity import first_able, has_insert_triples, has_words, word_eligible, word_similarity
from isi.insertion.step import initialize, insertion_of, learn, put
from isi.insertion.tasks import InsertTask, how_in, told_in
from isi.insertion.weighing import mean_relational_score, soft
from isi.studies.answering import TOLD, Picked, answers_of, asked_of, pick
from isi.studies.asking import JOINT
from isi.studies.planes import Plane, on, plane, turn

#: The paper's initializers that are shown, beside the one that params name.
SHOWN = ("xavier", "es", "rs", "ers")
#: What a map shows of the known entities.
THETA0 = "theta0"

#: What is shown, each in a table of its own: its schema, and what it is sorted by.
TABLES = {
    "entities": (SINGLES, "entity"), "indicators": (SINGLE_INDICATORS, "entity"), "places": (SINGLE_PLACES, "seed"),
    "answers": (SINGLE_ANSWERS, "entity"),
}  # fmt: skip


class Singled(Section):
    """Which insertions are shown, and how much of each."""

    size: Count
    epochs: Count
    #: the initializer that is shown beside ``SHOWN``
    best: Name
    #: of a centre, at most
    indicators: Count
    #: of a query, beside those that are true
    answers: Count


class Explorer(Singled, Study):
    """``explorer`` in params."""


@dataclass(frozen=True)
class SinglesTask:
    """Insert the novel entities of a stack of cells with each initializer, and show some of them."""

    cells: Cells
    #: of each initializer
    inserting: Sequence[InsertTask]
    joint: Vectors
    #: the seed in which each entity is shown
    seeds: Mapping[int, int]
    how: Singled


@dataclass(frozen=True)
class Singles:
    """What is shown of the entities of a task: a table of each of ``TABLES``."""

    entities: pd.DataFrame
    indicators: pd.DataFrame
    places: pd.DataFrame
    answers: pd.DataFrame


def first_seeds(novel: pd.DataFrame, size: int) -> dict[int, int]:
    """The first seed in which the first session of a size inserts each entity (``tables.NOVEL``)."""
    own = novel[(novel["size"] == size) & (novel["session"] == 1)].sort_values("seed", kind="stable")
    firsts = own.drop_duplicates("entity")
    return dict(zip(firsts["entity"].tolist(), firsts["seed"].tolist(), strict=True))


def single_out(task: SinglesTask) -> Singles:
    """Indicators, places and answers of the entities of a task that are shown."""
    cells, joint, picked = task.cells, task.joint.stack, pick(task.cells, task.seeds)
    theta0, known = task.inserting[0].theta0.stack, cells.session(0).entities
    queries = asked_of(cells, picked, cells.told_in(1, task.inserting[0].told.insert_triples))
    planes = [plane(vectors[own]) for vectors, own in zip(theta0.entity, known, strict=True)]
    turned, fitted = turn(joint.entity, theta0.entity, known)
    indicators = list[pd.DataFrame]()
    places = [_known_places(cells, picked, theta0.entity, planes), _places(cells, picked, turned, planes, JOINT, 0)]
    answers = [answers_of(joint, cells, queries, task.how.answers).assign(model=JOINT, epoch=0)]
    for inserting in task.inserting:
        name, (insertion, initial, *embeddings) = inserting.how.initializer, followed(inserting, cells)
        weights = weights_of(insertion, initial, inserting.how.options)
        if weights is not None:
            indicators.append(indicators_of(insertion, weights, initial.fallback, picked, name, task.how.indicators))
        for epoch, embedding in zip((0, task.how.epochs), embeddings, strict=True):
            places.append(_places(cells, picked, embedding.entity, planes, name, epoch))
            answers.append(answers_of(embedding, cells, queries, task.how.answers).assign(model=name, epoch=epoch))
    entities = pd.DataFrame({
        "entity": picked.entity.cpu().numpy(), "seed": _seeds(cells, picked),
        "told": (queries.truth == TOLD).sum((1, 2, 3)).cpu().numpy(),
        "shown": [planes[model].share for model in picked.model.tolist()], "fitted": fitted[picked.model].cpu().numpy(),
    })  # fmt: skip
    return Singles(entities, *(pd.concat(parts) for parts in (indicators, places, answers)))


def followed(task: InsertTask, cells: Cells) -> tuple[Insertion, Initial, Embedding, Embedding]:
    """What an initializer is given and gives, and the embedding as inserted and after all epochs of training."""
    before, after, told, how = cells.session(0), cells.session(1), told_in(task, 1), how_in(task, 1)
    theta0 = task.theta0.stack
    initial = initialize(theta0, before, told, how)
    inserted = put(theta0, told.novel, initial.vectors)
    trained = learn(inserted, after, told.novel, how, _to_the_end)
    return insertion_of(theta0, before, told, how), initial, inserted, trained


def _to_the_end(epoch: int, embedding: Embedding, models: Tensor) -> Tensor:  # noqa: ARG001
    return torch.ones(len(models), dtype=torch.bool)


# Indicators


def indicators_of(
    insertion: Insertion, weights: Tensor, fallback: Tensor, picked: Picked, model: str, most: int
) -> pd.DataFrame:
    """The entities of largest weight in the centre of each vector (``tables.SINGLE_INDICATORS``), most similar first.

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


def weights_of(insertion: Insertion, initial: Initial, options: Mapping[str, Option]) -> Tensor | None:
    """Weights of entities in the centre of each vector, (M, n, E); none of initializers without one.

    Of a soft hybrid, and of MAP, whose prior has its mean there, they are those of ``weighing.softly_by_both``.
    """
    if initial.indicators is not None:
        weight = initial.indicators.double()
        return weight / weight.sum(-1, keepdim=True).clamp(min=1)
    if not {"word_weight", "relation_weight"} <= options.keys():
        return None
    similar = float(options["word_weight"]) * word_similarity(insertion)
    related = float(options["relation_weight"]) * mean_relational_score(insertion)
    words, triples, named = has_words(insertion), has_insert_triples(insertion), word_eligible(insertion)
    weights, _ = first_able(
        insertion,
        (NONE, words & triples, soft(similar + related, named)),
        (RS, triples, soft(related, insertion.eligible[:, None])),
        (ES, words, soft(similar, named)),
    )
    return weights / weights.sum(-1, keepdim=True)


# Places


def _places(
    cells: Cells, picked: Picked, entity: Tensor, planes: Sequence[Plane], model: str, epoch: int
) -> pd.DataFrame:  # fmt: skip
    """Of novel entities, where tables of shape (M, E, d) have them (``tables.SINGLE_PLACES``)."""
    points = torch.stack([on(planes[m], entity[m, e]) for m, e in zip(picked.model, picked.entity, strict=True)])
    x, y = points.T.cpu().numpy()
    frame = pd.DataFrame({"seed": _seeds(cells, picked), "entity": picked.entity.cpu().numpy(), "x": x, "y": y})
    return frame.assign(model=model, epoch=epoch)


def _known_places(cells: Cells, picked: Picked, entity: Tensor, planes: Sequence[Plane]) -> pd.DataFrame:
    """The same of the known entities of each seed in which one is shown, in Θ⁰."""
    known, parts = cells.session(0).entities, []
    for model in sorted(set(picked.model.tolist())):
        x, y = on(planes[model], entity[model, known[model]]).T.cpu().numpy()
        ids = known[model].nonzero().flatten().cpu().numpy()
        parts.append(pd.DataFrame({"seed": cells.seeds[model], "entity": ids, "x": x, "y": y}))
    return pd.concat(parts).assign(model=THETA0, epoch=0)


def _seeds(cells: Cells, picked: Picked) -> list[int]:
    return [cells.seeds[model] for model in picked.model.tolist()]
