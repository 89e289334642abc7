"""A stage reads no more of params than its pipeline lists for it: every stage runs with nothing else."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import chdir
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import pytest
import yaml

from isi import stage as stages
from isi.tables import paths
from tests import small
from tests.listed_params import Listed, listed, restricted, restricted_context
from tools.workspace import DROP

NAME = small.NAME
CHANGES: dict[str, Any] = small.SMALL | {
    "experiments.ai2thor": DROP, "experiments.transfer": DROP,
    "experiments.published.initializers": ["xavier", "rs", "ers"],
    "experiments.published.immediate_only": [], "experiments.published.full_curves.sizes": [1],
    **{f"{name}.experiments": [NAME] for name in (
        "finetune_only", "sweep", "cross_validation", "rate_sweep", "trajectory", "compare_models", "affordances",
        "query_breakdown", "final_model", "explorer",
    )},
    "sweep.k": [2], "sweep.size": 1, "sweep.seeds": 1, "rate_sweep.size": 1, "rate_sweep.factors": [2.0],
    "cross_validation.folds": 2, "cross_validation.dimension": [], "cross_validation.ratio": [2],
    "cross_validation.learning_rate": [], "cross_validation.weight_decay": [], "compare_models.seeds": 1,
    "trajectory.size": 2, "trajectory.epochs": 1,
}  # fmt: skip
VARIANT = {
    "title": "another rate", "group": "causes", "experiments": [NAME], "initializers": ["rs"], "size": 1, "seeds": 1,
    "changes": {"training.learning_rate": 0.2, "finetuning.max_epochs": 1},
}  # fmt: skip
WORDS = {"source": "shipped", "text": "glove", "sha256": None}
GRAPH = {
    "title": "again", "source": {"reader": "published"}, "words": WORDS, "initializers": ["es"],
    "sessions": {"novel": "any", "sizes": [1], "seeds": 1},
}  # fmt: skip
HIDDEN = {
    "title": "Nations", "source": "pykeen", "words": None, "seeds": 1, "fraction": 0.1, "fewest": 5, "queries": 0.2,
    "max_insert_triples": [1], "initializers": ["mean"], "epochs": 1,
    "training": {"dimension": 4, "batch_size": 512, "learning_rate": 0.05, "negatives": 1, "valid": 0.1,
                 "max_epochs": 1, "frequency": 1, "patience": 1},
}  # fmt: skip
COMMANDS = (
    *small.STAGES, f"insert {NAME} xavier", f"insert {NAME} ers", f"finetune_only {NAME}", f"rank_affordances {NAME}",
    f"break_down_queries {NAME}", f"sweep_indicators {NAME} es", f"sweep_rates {NAME} rs", f"cross_validate {NAME}",
    f"trace_trajectory {NAME}", f"compare_models {NAME} distmult", f"train_final {NAME}", f"single_insertions {NAME}",
    "vary rate", "explore again", "insert_hidden nations",
)  # fmt: skip


@pytest.fixture(scope="module")
def project(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    folder = tmp_path_factory.mktemp("project")
    small.lay_out(folder, CHANGES)
    beyond = {"variants": {"rate": VARIANT}, "graphs": {"again": GRAPH}, "hidden": {"nations": HIDDEN}}
    (folder / paths.BEYOND_PARAMS).write_text(yaml.safe_dump(beyond, sort_keys=False), encoding="utf-8")
    with chdir(folder), pytest.MonkeyPatch.context() as patch:
        patch.setattr(stages, "context_of", restricted_context)
        yield folder


@pytest.mark.usefixtures("project")
@pytest.mark.parametrize("command", COMMANDS)  # in their order: a stage reads what earlier ones write
def test_a_stage_runs_with_the_params_that_are_listed_for_it_alone(command: str) -> None:
    if "hidden" in command and not find_spec("pykeen"):
        pytest.skip("PyKEEN is not installed")
    small.run(command)


@pytest.mark.usefixtures("project")
def test_every_stage_but_the_report_which_lists_nearly_all_is_tried() -> None:
    names = {
        name
        for path in (paths.PIPELINE, paths.BEYOND_PIPELINE)
        for name in yaml.safe_load(path.read_text(encoding="utf-8"))["stages"]
    }
    assert {command.split()[0] for command in COMMANDS} == names - {"report"}


@pytest.mark.usefixtures("project")
def test_what_is_not_listed_is_not_there() -> None:
    assert listed("insert", {"experiment": NAME, "initializer": "rs"})[paths.PARAMS][-1] == "initializers.rs"
    context = restricted_context("insert", {"experiment": NAME, "initializer": "rs"})
    assert context.params.seed == 0
    for section, key in ((context.params, "words"), (context.params.embedding, "dimension")):
        with pytest.raises(AttributeError):
            getattr(section, key)
    with pytest.raises(KeyError):
        context.params.initializers["es"]
    with pytest.raises(AssertionError):
        list(context.params.initializers)
    assert isinstance(restricted({"a": 1}, ["a"]), Listed)
