"""Rank the affordances of inserted entities by their initial vectors (Table 3)."""

from typing import Annotated, Any

import numpy as np
import pandas as pd
import torch
from pydantic import Field
from torch import Tensor

from isi.config import EachOnce, Name, Study
from isi.errors import InputError
from isi.models.stack import Embedding
from isi.tables import paths
from isi.tables.rules import FROM_0, FROM_1, NAME
from isi.tables.table import Table, concat
from stages.grid import GridPoints, InitializerList, is_listed
from stages.insert import with_vectors
from stages.runner import Compute, run, stack_height
from stages.stage import StageContext, stage
from stages.store import Store, model_of

#: Rank of each answer to (entity, relation, ?) right after insertion.
AFFORDANCES = Table(
    "data/analyses/affordances/{experiment}.parquet",
    {"initializer": NAME, "seed": FROM_0, "entity": FROM_0, "answer": FROM_0, "rank": FROM_1},
)


class Affordances(Study):
    """``affordances`` in params: the experiments, the relation that is queried,
    and the entities of Table 3, by experiment.
    """

    rules = (
        (
            lambda section: set(section.experiments) <= set(section.entities),
            "entities: expected a list for each of the experiments",
        ),
    )
    relation: str
    entities: dict[Name, Annotated[list[str], Field(min_length=1), EachOnce]]


@stage
def rank_affordances(context: StageContext, experiment: str) -> None:
    params, store = context.params.of(experiment), Store(experiment)
    model, compute = model_of(params), params.read("compute", Compute)
    grid, relations = store.grid(stack_height(compute)), store.graph().relations
    name = params.read("affordances", Affordances).relation
    if name not in relations:
        expected = f"expected a relation of {experiment}: {', '.join(relations)}"
        raise InputError(paths.PARAMS, "affordances.relation", expected)
    of_experiment = params.read(f"experiments.{experiment}.initializers", InitializerList)
    tasks = [
        (
            points,
            store.theta0(points, model),
            initializer,
            store.initial_vectors(initializer, points),
            relations.index(name),
        )
        for initializer in params.read("initializers", dict[str, Any])
        if is_listed(of_experiment, initializer)
        for points in grid
    ]
    ranked = run(rank_answers, tasks, compute, "affordances")
    AFFORDANCES.write(concat(ranked, AFFORDANCES), context.stage, experiment=experiment)


def rank_answers(
    points: GridPoints, theta0: Embedding, initializer: str, vectors: np.ndarray, relation: int
) -> pd.DataFrame:
    """Rows of ``AFFORDANCES``: entities of D¹ ranked for (novel, relation, ?),
    with novel vectors (M, n, d).
    """
    session, novel = points.session(1), points.novel_ids
    embedding = with_vectors(theta0, novel, torch.as_tensor(vectors))
    scores = embedding.score_tails(novel, torch.full_like(novel, relation))
    rank = ranks_of(scores, session.entities[:, None]).cpu().numpy()
    model, place, answer = rank.nonzero()
    columns = {
        "seed": np.array(points.seeds)[model],
        "entity": points.novel[model, place],
        "answer": answer,
    }
    return pd.DataFrame(columns | {"rank": rank[model, place, answer]}).assign(
        initializer=initializer
    )


def ranks_of(scores: Tensor, candidates: Tensor) -> Tensor:
    """Rank of each candidate in its row, from 1; ties go to the lower id; 0 for other entities;
    shapes (..., E).
    """
    order = (
        scores.masked_fill(~candidates, -torch.inf)
        .sort(dim=-1, descending=True, stable=True)
        .indices
    )
    return (order.argsort(-1) + 1) * candidates


if __name__ == "__main__":
    rank_affordances()
