"""Rank what can be done with inserted entities, from the vectors that were inserted."""

from isi.analyses.affordances import AFFORDANCES, RankingTask, ranks
from isi.errors import InputError
from isi.experiment.insert import is_listed
from isi.experiment.runner import run, stack_height
from isi.experiment.store import Store
from isi.experiment.train import model_of
from isi.stage import StageContext, stage
from isi.tables import paths
from isi.tables.table import concat


@stage
def rank_affordances(context: StageContext, experiment: str) -> None:
    """Rank what can be done with inserted entities, from the vectors that were inserted."""
    params, store, model = context.params, Store(experiment), model_of(context.params)
    grid, relations = store.grid(stack_height(params.compute)), store.graph().relations
    if params.affordances.relation not in relations:
        expected = f"expected a relation of {experiment}: {', '.join(relations)}"
        raise InputError(paths.PARAMS, "affordances.relation", expected)
    relation, names, tasks = relations.index(params.affordances.relation), list[str](), []
    for name in params.initializers:
        if is_listed(params.experiments[experiment].initializers, name):
            for points in grid:
                vectors = store.initial_vectors(name, points)
                tasks.append(RankingTask(points, store.theta0(points, model), vectors, relation))
                names.append(name)
    ranked = run(ranks, tasks, params.compute, "affordances")
    frame = concat((frame.assign(initializer=name) for name, frame in zip(names, ranked, strict=True)), AFFORDANCES)
    AFFORDANCES.write(frame, context.stage, experiment=experiment)


if __name__ == "__main__":
    rank_affordances()
