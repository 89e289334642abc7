"""Ask every model right after insertion, and tell its answers by what was asked."""

from __future__ import annotations

import pandas as pd

from isi.analyses import query_breakdown
from isi.analyses.query_breakdown import QUERY_BREAKDOWN, USED_COORDINATES, QueryBreakdownTask
from isi.experiment.insert import is_listed
from isi.experiment.runner import compute_of, run, stack_height
from isi.experiment.store import Store
from isi.experiment.tables import JOINT
from isi.experiment.train import model_of
from isi.stage import StageContext, stage


@stage
def ask(given: StageContext, experiment: str) -> None:
    """Ask every model right after insertion, and tell its answers by what was asked."""
    store, family, compute = Store(experiment), model_of(given), compute_of(given)
    listed = f"experiments.{experiment}.initializers"
    names = [name for name in given.raw("initializers") if is_listed(given, listed, name)]
    insert_triples = store.insert_triples()
    tasks = [
        QueryBreakdownTask(
            points, store.theta0(points, family), store.joint(points, family),
            {name: store.initial_vectors(name, points) for name in names},
            store.insert_triples_of(points, insert_triples),
        )
        for points in store.grid(stack_height(compute))
    ]  # fmt: skip
    asked = pd.concat(run(query_breakdown.break_down, tasks, compute, f"{experiment}, asked"))
    asked = asked.sort_values(["size", "seed"], kind="stable")
    relation, seed = JOINT.read(["relation", "seed"], experiment=experiment).values()
    used = query_breakdown.used(family, relation.numpy(), seed.tolist(), store.graph().relations)
    QUERY_BREAKDOWN.write(asked, given.stage, experiment=experiment)
    USED_COORDINATES.write(used, given.stage, experiment=experiment)


if __name__ == "__main__":
    ask()
