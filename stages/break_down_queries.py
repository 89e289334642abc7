"""Measure every model right after insertion by relation,
hidden slot and role of the novel entity.
"""

import pandas as pd

from isi.analyses.query_breakdown import (
    QUERY_BREAKDOWN,
    USED_COORDINATES,
    break_down,
    used_coordinates,
)
from isi.experiment.runner import run, stack_height
from isi.experiment.store import JOINT, Store
from isi.stage import StageContext, stage


@stage
def break_down_queries(context: StageContext, experiment: str) -> None:
    params, store, model = context.params, Store(experiment), context.params.model_of()
    initializers = params.initializers_of(experiment)
    tasks = [
        (
            points,
            store.theta0(points, model),
            store.joint(points, model),
            {name: store.initial_vectors(name, points) for name in initializers},
        )
        for points in store.grid(stack_height(params.compute))
    ]
    answers = pd.concat(run(break_down, tasks, params.compute, f"{experiment}, queries"))
    relation, seed = JOINT.read(["relation", "seed"], experiment=experiment).values()
    used = used_coordinates(model, relation, seed.tolist(), store.graph().relations)
    QUERY_BREAKDOWN.write(
        answers.sort_values(["size", "seed"], kind="stable"), context.stage, experiment=experiment
    )
    USED_COORDINATES.write(used, context.stage, experiment=experiment)


if __name__ == "__main__":
    break_down_queries()
