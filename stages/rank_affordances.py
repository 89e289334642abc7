"""Rank the affordances of inserted entities by their initial vectors."""

from isi.analyses.affordances import AFFORDANCES, rank_answers
from isi.errors import InputError
from isi.tables import paths
from isi.tables.table import concat
from stages.runner import run, stack_height
from stages.stage import StageContext, stage
from stages.store import Store


@stage
def rank_affordances(context: StageContext, experiment: str) -> None:
    params, store = context.params.of(experiment), Store(experiment)
    model = params.model_of()
    grid, relations = store.grid(stack_height(params.compute)), store.graph().relations
    name = params.affordances.relation
    if name not in relations:
        expected = f"expected a relation of {experiment}: {', '.join(relations)}"
        raise InputError(paths.PARAMS, "affordances.relation", expected)
    tasks = [
        (
            points,
            store.theta0(points, model),
            initializer,
            store.initial_vectors(initializer, points),
            relations.index(name),
        )
        for initializer in params.initializers_of(experiment)
        for points in grid
    ]
    ranked = run(rank_answers, tasks, params.compute, "affordances")
    AFFORDANCES.write(concat(ranked, AFFORDANCES), context.stage, experiment=experiment)


if __name__ == "__main__":
    rank_affordances()
