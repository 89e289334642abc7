"""Insert novel entities with one initializer again, fine-tuned until convergence at other rates."""

from __future__ import annotations

from dataclasses import replace

from isi.analyses.sweep import RATE_SWEEP, RateFactors
from isi.experiment.insert import insert_stack, inserting, insertion_tasks
from isi.experiment.runner import compute_of, run, stack_height
from isi.experiment.store import Store
from isi.stage import StageContext, stage
from isi.tables.table import concat


@stage
def vary_rate(given: StageContext, experiment: str, initializer: str) -> None:
    """Insert novel entities with one initializer again, fine-tuned until convergence at other rates."""
    study, how, compute = given.section("rates", RateFactors), inserting(given, initializer), compute_of(given)
    store = Store(experiment)
    grid, tasks, factors = store.grid(stack_height(compute), study.size), [], []
    for factor in study.factors:
        at_rate = how.optimizer.model_copy(update={"learning_rate": factor * how.optimizer.learning_rate})
        tasks += insertion_tasks(store, given, replace(how, optimizer=at_rate), grid)
        factors += [factor] * len(grid)
    done = run(insert_stack, tasks, compute, f"rates, {initializer}")
    runs = concat((result.runs.assign(factor=factor) for factor, result in zip(factors, done, strict=True)), RATE_SWEEP)
    RATE_SWEEP.write(runs, given.stage, experiment=experiment, initializer=initializer)


if __name__ == "__main__":
    vary_rate()
