"""Ask every model right after insertion, and tell its answers by what was asked."""

from __future__ import annotations

import pandas as pd

from isi.analyses import query_breakdown
from isi.analyses.query_breakdown import QueryBreakdownTask
from isi.experiment.insert import is_listed
from isi.experiment.runner import compute_of, run, stack_height
from isi.experiment.store import Store
from isi.experiment.train import model_of
from isi.stage import StageContext, stage
from isi.tables import catalogue, io, paths


@stage
def ask(given: StageContext, experiment: str) -> None:
    """Ask every model right after insertion, and tell its answers by what was asked."""
    store, family, compute = Store(experiment, given.provenance), model_of(given), compute_of(given)
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
    relation, seed = store.tensors(paths.joint(experiment), "relation", "seed")
    used = query_breakdown.used(family, relation, seed.tolist(), store.graph().relations)
    io.write(paths.asked(experiment), asked, catalogue.ASKED, given.provenance)
    io.write(paths.used(experiment), used, catalogue.USED, given.provenance)


if __name__ == "__main__":
    ask()
