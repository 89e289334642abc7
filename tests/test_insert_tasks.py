"""The inputs of insertion tasks, from params and from the tables of an experiment."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from isi.errors import InputError
from isi.evaluation.query_sets import CONVERGING
from isi.experiment.insert import joint_targets
from isi.experiment.store import RUNS
from isi.params import load
from isi.tables import paths
from tests.small_graphs import points_of, random_graph

POINTS = points_of(random_graph(12, 2, 80), 2, [4, 6], steps=2)
PARAMS = load(Path(__file__).parent.parent / paths.PARAMS).model_copy(
    update={
        "seed": 9,
        "initializers": {"es": {"k": 4}, "rs": {"k": 6}, "ers": {"k": 2, "candidates": 8}},
    }
)


def joint_runs() -> pd.DataFrame:
    """Unsorted runs of the joint model, also of grid points without a task;
    MRR* encodes size, seed, ..., scope.
    """
    rows = [
        (
            size,
            seed,
            session,
            epoch,
            scope,
            1000 * size + 100 * seed + 10 * session + epoch + place / 10,
        )
        for size in (2, 3)
        for seed in (8, 6, 5, 4)
        for session in (2, 1)
        for epoch in (1, 0)
        for place, scope in enumerate((*CONVERGING, "novel"))
    ]
    return pd.DataFrame(rows, columns=["size", "seed", "session", "epoch", "scope", "mrr_star"])


def test_convergence_is_measured_against_the_joint_models_at_once_in_the_same_cells() -> None:
    targets = joint_targets(joint_runs(), POINTS)
    assert targets.keys() == {(session, scope) for session in (1, 2) for scope in CONVERGING}
    for (session, scope), values in targets.items():
        place = CONVERGING.index(scope) / 10
        assert values.dtype == np.float64
        np.testing.assert_allclose(
            values, [2400 + 10 * session + place, 2600 + 10 * session + place]
        )
        values[:] = 0  # changes this task's copy alone
    assert joint_targets(joint_runs(), POINTS)[1, CONVERGING[0]].all()


@pytest.mark.parametrize(("session", "scope"), [(1, CONVERGING[0]), (2, CONVERGING[-1])])
def test_a_cell_that_the_joint_models_lack_is_named(session: int, scope: str) -> None:
    runs = joint_runs()
    cell = (
        runs["size"].eq(2)
        & runs["session"].eq(session)
        & runs["scope"].eq(scope)
        & runs["epoch"].eq(0)
    )
    with pytest.raises(InputError) as refused:
        joint_targets(runs[~(cell & runs["seed"].eq(6))], POINTS)
    expected = "expected a row of seed 6 at epoch 0"
    where = f"size 2, session {session}, scope {scope}"
    assert refused.value.args == (
        str(RUNS.path(experiment=POINTS.experiment, model="joint")),
        where,
        expected,
    )


@pytest.mark.parametrize(
    ("name", "options"), [("es", {"k": 4}), ("ers", {"k": 2, "candidates": 8})]
)
def test_params_say_how_an_initializer_inserts(name: str, options: dict[str, int]) -> None:
    config = PARAMS.insert_config(name, [3])
    assert (config.initializer, config.options, config.root, config.full_curves) == (
        name,
        options,
        9,
        [3],
    )
    assert config.margin == PARAMS.convergence.margin
    assert (config.negatives, config.optimizer) == (PARAMS.negatives, PARAMS.finetuning)
    assert PARAMS.insert_config(name, options={**options, "k": 1}).options == {**options, "k": 1}
    assert config.training(max_epochs=0).optimizer == PARAMS.finetuning.model_copy(
        update={"max_epochs": 0}
    )
    with pytest.raises(InputError, match=rf"^params\.yaml: initializers\.{name}\.k: "):
        PARAMS.insert_config(name, options={**options, "k": 0})
