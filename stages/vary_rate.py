"""Insert novel entities with one initializer again, fine-tuned until convergence at other rates."""

from __future__ import annotations

from dataclasses import replace

from isi.base import paths, tables
from isi.base.stage import Given, stage
from isi.experiments.executor import compute_of, run, stack_height
from isi.experiments.store import Store
from isi.insertion.tasks import insert, inserting, insertion_tasks
from isi.studies.sweeps import Factors


@stage
def vary_rate(given: Given, experiment: str, initializer: str) -> None:
    """Insert novel entities with one initializer again, fine-tuned until convergence at other rates."""
    study, how, compute = given.section("rates", Factors), inserting(given, initializer), compute_of(given)
    store = Store(experiment, given.provenance)
    cells, tasks, factors = store.cells(stack_height(compute), study.size), [], []
    for factor in study.factors:
        at_rate = how.optimizer.model_copy(update={"learning_rate": factor * how.optimizer.learning_rate})
        tasks += insertion_tasks(store, given, replace(how, optimizer=at_rate), cells)
        factors += [factor] * len(cells)
    done = run(insert, tasks, compute, f"rates, {initializer}")
    runs = tables.together(
        (result.runs.assign(factor=factor) for factor, result in zip(factors, done, strict=True)), tables.RATE_SWEEP
    ).sort_values(["factor", "size", "seed", "session", "epoch", "scope"])
    tables.write(paths.rate_sweep(experiment, initializer), runs, tables.RATE_SWEEP, given.provenance)


if __name__ == "__main__":
    vary_rate()
