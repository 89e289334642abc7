"""Break down what every model answers right after insertion, by the kind of query."""

import pandas as pd

from isi.analyses import query_breakdown
from isi.analyses.query_breakdown import QUERY_BREAKDOWN, USED_COORDINATES, QueryBreakdownTask
from isi.experiment.insert import is_listed
from isi.experiment.runner import run, stack_height
from isi.experiment.store import Store
from isi.experiment.tables import JOINT
from isi.experiment.train import model_of
from isi.stage import StageContext, stage


@stage
def break_down_queries(context: StageContext, experiment: str) -> None:
    """Break down what every model answers right after insertion, by the kind of query."""
    params, store = context.params, Store(experiment)
    model, insert_triples = model_of(params), store.insert_triples()
    initializers = [
        name for name in params.initializers if is_listed(params.experiments[experiment].initializers, name)
    ]
    tasks = [
        QueryBreakdownTask(
            points, store.theta0(points, model), store.joint(points, model),
            {name: store.initial_vectors(name, points) for name in initializers},
            store.insert_triples_of(points, insert_triples),
        )
        for points in store.grid(stack_height(params.compute))
    ]  # fmt: skip
    answers = pd.concat(run(query_breakdown.break_down, tasks, params.compute, f"{experiment}, queries"))
    relation, seed = JOINT.read(["relation", "seed"], experiment=experiment).values()
    used = query_breakdown.used(model, relation.numpy(), seed.tolist(), store.graph().relations)
    QUERY_BREAKDOWN.write(answers.sort_values(["size", "seed"], kind="stable"), context.stage, experiment=experiment)
    USED_COORDINATES.write(used, context.stage, experiment=experiment)


if __name__ == "__main__":
    break_down_queries()
