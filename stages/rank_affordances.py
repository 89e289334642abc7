"""Rank what can be done with inserted entities, from the vectors that were inserted."""

from __future__ import annotations

from isi.base import paths, tables
from isi.base.errors import InputError
from isi.base.stage import Given, stage
from isi.experiments.executor import compute_of, run, stack_height
from isi.experiments.learning import family_of
from isi.experiments.store import Store
from isi.insertion.tasks import lists
from isi.studies.affordances import Asked, RankingTask, ranks


@stage
def rank_affordances(given: Given, experiment: str) -> None:
    """Rank what can be done with inserted entities, from the vectors that were inserted."""
    study, compute, family = given.section("affordances", Asked), compute_of(given), family_of(given)
    store = Store(experiment, given.provenance)
    cells = store.cells(stack_height(compute))
    relations = store.graph().relations
    if study.relation not in relations:
        expected = f"expected a relation of {experiment}: {', '.join(relations)}"
        raise InputError(paths.PARAMS, "affordances.relation", expected)
    relation, names, tasks = relations.index(study.relation), [], []
    for name in given.raw("initializers"):
        if lists(given, f"experiments.{experiment}.initializers", name):
            for cell in cells:
                vectors = store.initial_vectors(name, cell)
                tasks.append(RankingTask(cell, store.theta0(cell, family), vectors, relation))
                names.append(name)
    ranked = run(ranks, tasks, compute, "affordances")
    frame = tables.together(
        (frame.assign(initializer=name) for name, frame in zip(names, ranked, strict=True)), tables.AFFORDANCES
    )
    tables.write(paths.affordances(experiment), frame, tables.AFFORDANCES, given.provenance)


if __name__ == "__main__":
    rank_affordances()
