"""A stage reads only the params that its pipeline lists: every stage runs with those alone."""

from collections.abc import Iterator
from contextlib import chdir
from pathlib import Path
from typing import Any

import pytest
import yaml

from isi.models.model import EmbeddingParams
from stages import stage as stages
from stages.pipeline import BEYOND_PARAMS, BEYOND_PIPELINE, PIPELINE
from tests import stage_run
from tests.beyond_entries import GRAPH, SESSIONS, VARIANT
from tests.listed_params import restricted_context
from tools.workspace import DROP

NAME = stage_run.NAME
CHANGES: dict[str, Any] = stage_run.SMALL | {
    "experiments.ai2thor": DROP,
    "experiments.transfer": DROP,
    "experiments.paper_transfer": DROP,
    f"experiments.{NAME}.initializers": ["xavier", "rs", "ers"],
    f"experiments.{NAME}.full_curves": [1],
    f"affordances.entities.{NAME}": ["mug"],
    **{
        f"{name}.experiments": [NAME]
        for name in (
            "measure_changes",
            "finetune_only",
            "sweep",
            "cross_validation",
            "trajectory",
            "affordances",
            "final_model",
            "explorer",
        )
    },
    "sweep.k": [2],
    "sweep.size": 1,
    "sweep.seeds": 1,
    "sweep.finetuned_seeds": 1,
    "cross_validation.folds": 2,
    "cross_validation.dimension": [],
    "cross_validation.ratio": [2],
    "cross_validation.learning_rate": [],
    "cross_validation.weight_decay": [],
    "trajectory.size": 2,
    "trajectory.epochs": 1,
}
BEYOND: dict[str, Any] = {
    "variants": {
        "rate": VARIANT
        | {
            "experiments": [NAME],
            "initializers": ["rs"],
            "size": 1,
            "seeds": 1,
            "changes": {"training.learning_rate": 0.2, "finetuning.max_epochs": 1},
        }
    },
    "graphs": {"again": GRAPH | {"sessions": SESSIONS | {"sizes": [1], "seeds": 1}}},
}
COMMANDS = (
    *stage_run.STAGES,
    f"insert {NAME} xavier",
    f"insert {NAME} ers",
    f"finetune_only {NAME}",
    f"rank_affordances {NAME}",
    f"sweep_indicators {NAME} es",
    f"cross_validate {NAME}",
    f"trace_trajectory {NAME}",
    f"train_final {NAME}",
    "demonstrate",
    "vary rate",
    "explore again",
    "tables_beyond",
)


@pytest.fixture(scope="module")
def project(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    folder = tmp_path_factory.mktemp("project")
    stage_run.lay_out(folder, CHANGES)
    (folder / BEYOND_PARAMS).write_text(yaml.safe_dump(BEYOND, sort_keys=False), encoding="utf-8")
    with chdir(folder), pytest.MonkeyPatch.context() as patch:
        patch.setattr(stages, "context_of", restricted_context)
        yield folder


@pytest.mark.usefixtures("project")
# in their order: a stage reads what earlier ones write
@pytest.mark.parametrize("command", COMMANDS)
def test_a_stage_runs_with_the_params_that_are_listed_for_it_alone(command: str) -> None:
    stage_run.run(command)


@pytest.mark.usefixtures("project")
def test_every_stage_but_the_reports_which_list_nearly_all_is_tried() -> None:
    pipelines = [
        yaml.safe_load(path.read_text(encoding="utf-8")) for path in (PIPELINE, BEYOND_PIPELINE)
    ]
    names = {name for pipeline in pipelines for name in pipeline["stages"]}
    assert {command.split()[0] for command in COMMANDS} == names - {
        "tables",
        "report",
        "report_beyond",
    }


@pytest.mark.usefixtures("project")
def test_params_that_are_not_listed_cannot_be_read() -> None:
    params = restricted_context("insert", {"experiment": NAME, "initializer": "rs"}).params
    assert params.seed == 0
    with pytest.raises(AssertionError):
        params.read("embedding.dimension", int)
    with pytest.raises(AssertionError):
        params.read("initializers.es", dict[str, Any])
    with pytest.raises(AttributeError):
        _ = params.read("embedding", EmbeddingParams).dimension
