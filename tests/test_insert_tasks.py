"""The inputs of insertion tasks, from params and from the tables of an experiment."""

from pathlib import Path

import pandas as pd
import pytest

from isi.errors import InputError
from isi.tables import paths
from stages.insert import config_of_experiment, insert_config, joint_targets, targets_below
from stages.params import StageParams
from stages.store import RUNS
from tests.small_graphs import points_of, random_graph

POINTS = points_of(random_graph(12, 2, 80), 2, [4, 6])
VALUES = StageParams.load(Path(__file__).parent.parent / paths.PARAMS).values | {
    "seed": 9,
    "initializers": {"es": {"k": 4}, "rs": {"k": 6}, "ers": {"k": 2, "candidates": 8}},
}
PARAMS = StageParams(VALUES)


def joint_rows() -> pd.DataFrame:
    """Unsorted rows of the joint models, also of grid points without a task; values encode size,
    seed, epoch and scope.
    """
    rows = [
        (size, seed, epoch, change, scope, 1000 * size + 100 * seed + 10 * epoch + place)
        for size in (2, 3)
        for seed in (8, 6, 5, 4)
        for epoch in (1, 0)
        for place, (change, scope) in enumerate(PLACES)
    ]
    columns = ["size", "seed", "epoch", "change", "scope", "value"]
    return pd.DataFrame(rows, columns=columns).astype({"value": float})


PLACES = [("none", "known"), ("none", "novel"), ("one_group", "weighted")]


def test_convergence_is_measured_against_the_joint_models_of_the_same_cells() -> None:
    targets = joint_targets(joint_rows(), POINTS)
    found = {(name, scope): list(v) for name, own in targets.items() for scope, v in own.items()}
    assert found == {key: [2400.0 + place, 2600.0 + place] for place, key in enumerate(PLACES)}
    below = targets_below(targets, 0.5)
    assert [target.query_set for target in below["none"]] == ["known", "novel"]
    (of_all,) = below["one_group"]
    assert (of_all.query_set, of_all.measure) == ("d1", "mrr")
    assert of_all.value.tolist() == [2401.5, 2601.5]


def test_a_cell_that_the_joint_models_lack_is_named() -> None:
    rows = joint_rows()
    cell = rows["size"].eq(2) & rows["seed"].eq(6) & rows["scope"].eq("novel") & rows["epoch"].eq(0)
    file = str(RUNS.path(experiment=POINTS.experiment, model="joint"))
    expected = "expected a row of each seed of size 2 at epoch 0"
    for left, scope in ((rows[~cell], "novel"), (rows[:0], "known")):
        with pytest.raises(InputError) as refused:
            joint_targets(left, POINTS)
        assert refused.value.args == (file, f"scope {scope}", expected)


@pytest.mark.parametrize(
    ("name", "options"), [("es", {"k": 4}), ("ers", {"k": 2, "candidates": 8})]
)
def test_params_say_how_an_initializer_inserts(name: str, options: dict[str, int]) -> None:
    config = config_of_experiment(PARAMS, "ai2thor", name)
    assert (config.initializer, config.options, config.root) == (name, options, 9)
    experiment = VALUES["experiments"]["ai2thor"]
    assert (config.full_curves, config.finetuned) == (
        experiment["full_curves"],
        experiment["finetuned"]["seeds"],
    )
    assert config.margin == VALUES["convergence"]["margin"]
    assert config.negatives.model_dump() == VALUES["negatives"]
    assert config.optimizer.model_dump() == VALUES["finetuning"]
    assert insert_config(PARAMS, name, {**options, "k": 1}).options == {**options, "k": 1}
    with pytest.raises(InputError, match=rf"^params\.yaml: initializers\.{name}\.k: "):
        insert_config(PARAMS, name, {**options, "k": 0})
