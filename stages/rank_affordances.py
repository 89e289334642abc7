"""Rank what can be done with inserted entities, from the vectors that were inserted."""

from __future__ import annotations

from isi.analyses.affordances import AFFORDANCES, AffordanceSettings, RankingTask, ranks
from isi.errors import InputError
from isi.experiment.insert import is_listed
from isi.experiment.runner import compute_of, run, stack_height
from isi.experiment.store import Store
from isi.experiment.train import model_of
from isi.stage import StageContext, stage
from isi.tables import paths
from isi.tables.table import concat


@stage
def rank_affordances(given: StageContext, experiment: str) -> None:
    """Rank what can be done with inserted entities, from the vectors that were inserted."""
    study, compute, family = given.section("affordances", AffordanceSettings), compute_of(given), model_of(given)
    store = Store(experiment)
    grid = store.grid(stack_height(compute))
    relations = store.graph().relations
    if study.relation not in relations:
        expected = f"expected a relation of {experiment}: {', '.join(relations)}"
        raise InputError(paths.PARAMS, "affordances.relation", expected)
    relation, names, tasks = relations.index(study.relation), [], []
    for name in given.raw("initializers"):
        if is_listed(given, f"experiments.{experiment}.initializers", name):
            for points in grid:
                vectors = store.initial_vectors(name, points)
                tasks.append(RankingTask(points, store.theta0(points, family), vectors, relation))
                names.append(name)
    ranked = run(ranks, tasks, compute, "affordances")
    frame = concat((frame.assign(initializer=name) for name, frame in zip(names, ranked, strict=True)), AFFORDANCES)
    AFFORDANCES.write(frame, given.stage, experiment=experiment)


if __name__ == "__main__":
    rank_affordances()
