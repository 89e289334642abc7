"""Variants: fewer insert triples, other params, and agreement with the first pipeline's runs."""

import re
from collections import Counter
from collections.abc import Callable
from copy import deepcopy
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
import torch
import yaml

from isi.config import check
from isi.errors import InputError
from isi.evaluation.changes import change_rows
from isi.tables import paths
from isi.training.fit import TrainConfig
from stages.breakdown import break_down
from stages.check_params import Params, load_beyond
from stages.check_params import load as load_params
from stages.insert import InsertConfig, insert_stack, joint_targets, with_vectors
from stages.params import StageParams
from stages.train_joint import evaluate_stack
from stages.vary import (
    LEARNED,
    VARIANT_QUERIES,
    VARIANT_RUNS,
    Models,
    Variant,
    VariantTask,
    limit_insert_triples,
    run_variant,
    train_models,
)
from tests import stage_run
from tests.beyond_entries import GRAPH as GRAPH_EXPERIMENT
from tests.beyond_entries import VARIANT, copy_pipelines, list_entries
from tests.small_graphs import points_of
from tests.small_grid import GRAPH, INITIALIZERS, LEARNING, MARGIN, OPTIMIZER, SAMPLED, SEEDS, WORDS
from tools.workspace import DROP, change, change_all

ROOT = Path(__file__).parent.parent
NAMES = ("xavier", "es", "rs")


def rows_of(triples: np.ndarray) -> list[tuple[int, ...]]:
    return [tuple(row) for row in triples.tolist()]


# Fewer insert triples


def test_so_many_of_each_entity_are_given_and_the_fewer_are_part_of_the_more() -> None:
    points = points_of(GRAPH, 2, SEEDS)
    given = points.insert_triples
    number = Counter(row[:2] for row in rows_of(given))
    assert max(number.values()) > 3
    fewer: set[tuple[int, ...]] = set()
    for most in range(6):
        fewer_rows = rows_of(limit_insert_triples(points, most, 0))
        assert Counter(row[:2] for row in fewer_rows) == Counter(
            {slot: min(most, n) for slot, n in number.items()}
        )
        # in their order
        assert fewer_rows == [row for row in rows_of(given) if row in set(fewer_rows)]
        assert fewer <= set(fewer_rows)
        fewer = set(fewer_rows)
    assert rows_of(limit_insert_triples(points, None, 0)) == rows_of(given)
    assert limit_insert_triples(
        replace(points, insert_triples=np.empty((0, 3), np.int64)), 3, 0
    ).shape == (0, 3)


def test_insert_triples_are_drawn_anew_for_each_entity_and_root() -> None:
    points = points_of(GRAPH, 2, SEEDS)
    given = points.insert_triples
    one, other = (rows_of(limit_insert_triples(points, 1, root)) for root in (0, 1))
    first = {row[:2]: row for row in reversed(rows_of(given))}
    assert one != other
    # neither always nor never the first
    assert 0 < sum(row != first[row[:2]] for row in one) < len(one)


# What params change


def test_values_change_at_dotted_keys_and_nothing_else_does() -> None:
    before = StageParams.load()
    after = before.changed(
        {"training.max_epochs": 9, "words.text": "phrase", "initializers.es.k": 3}
    )
    assert after.read("training.max_epochs", int) == 9
    assert after.read("words.text", str) == "phrase"
    assert after.read("initializers.es", dict[str, int]) == {"k": 3}
    assert before == StageParams.load()  # to its depths
    back = {"training.max_epochs": 200, "words.text": "definition", "initializers.es.k": 8}
    assert after.changed(back) == before


@pytest.mark.parametrize(
    "dotted",
    [
        "seed",
        "training",
        "trainings.rate",
        "seed.more",
        "training.rate",
        "words.text.more",
        "sweep.size",
    ],
)
def test_a_change_of_what_may_not_be_changed_is_refused_by_its_key(dotted: str) -> None:
    changes = {"words.text": "phrase", dotted: 1}
    with pytest.raises(InputError) as refused:
        check(StageParams.load().changed(changes).values, Params, "")
    assert dotted.split(".")[0] in str(refused.value)


def test_a_variant_knows_what_its_changes_concern() -> None:
    variant = Variant(
        **VARIANT, changes={"finetuning.learning_rate": 1, "training.weight_decay": 1}
    )
    assert variant.changes_one_of("training")
    assert variant.changes_one_of(*LEARNED)
    assert not variant.changes_one_of("words", "training.weight_decay", "weight_decay")
    assert not Variant(**VARIANT, changes={"training_log.own": 1}).changes_one_of(*LEARNED)


# The runs


def stored() -> Models:
    """Θ⁰ and the joint models, trained as in the first pipeline."""
    return train_models(points_of(GRAPH, 2, SEEDS), LEARNING)


def task(start: Models | TrainConfig, most: int | None = None) -> VariantTask:
    configs = {
        name: InsertConfig(name, INITIALIZERS[name], 0, SAMPLED, OPTIMIZER, MARGIN, len(SEEDS))
        for name in NAMES
    }
    return points_of(GRAPH, 2, SEEDS), start, WORDS, configs, most


def of_model(frame: pd.DataFrame, model: str) -> pd.DataFrame:
    return frame[frame["model"] == model].drop(columns="model").reset_index(drop=True)


def test_from_stored_embeddings_the_runs_are_those_of_the_first_pipeline() -> None:
    theta0, joint = stored()
    points, *_, configs, _ = variant_task = task((theta0, joint))
    runs, answers = run_variant(*variant_task)
    measured = evaluate_stack(points, joint)
    targets = joint_targets(change_rows(measured), points)
    inserted = {
        name: insert_stack(points, theta0, WORDS, targets, config)
        for name, config in configs.items()
    }
    assert set(runs["model"]) == {*NAMES, "joint"}
    pd.testing.assert_frame_equal(of_model(runs, "joint"), measured.reset_index(drop=True))
    for name, result in inserted.items():
        pd.testing.assert_frame_equal(of_model(runs, name), result.runs.reset_index(drop=True))
    novel = points.novel_ids
    embeddings = {
        name: with_vectors(theta0, novel, torch.from_numpy(result.vectors))
        for name, result in inserted.items()
    }
    embeddings["joint"] = joint[0]
    same = pd.concat(break_down(points, theta, name) for name, theta in embeddings.items())
    pd.testing.assert_frame_equal(answers.reset_index(drop=True), same.reset_index(drop=True))


def test_queries_are_the_same_whatever_the_number_of_insert_triples() -> None:
    start = stored()
    everything, nothing, one = (run_variant(*task(start, most)) for most in (None, 0, 1))
    groups = [
        "model",
        "seed",
        "scope",
        "relation",
        "hidden",
        "novel",
        "queries",
        "observations",
    ]
    for runs, answers in (nothing, one):
        pd.testing.assert_frame_equal(answers[groups], everything[1][groups])
        for model in ("xavier", "es", "joint"):  # these do not use insert triples
            pd.testing.assert_frame_equal(of_model(answers, model), of_model(everything[1], model))
        assert not np.allclose(
            of_model(answers, "rs")["mrr_star"], of_model(everything[1], "rs")["mrr_star"]
        )
        pd.testing.assert_frame_equal(of_model(runs, "joint"), of_model(everything[0], "joint"))


# What is listed


@pytest.fixture
def workspace(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    copy_pipelines(tmp_path)
    monkeypatch.chdir(tmp_path)


ENTRIES = yaml.safe_load((ROOT / "tests/mistakes/entries.yaml").read_text(encoding="utf-8"))
VALID = {
    "variants": VARIANT,
    "graphs": GRAPH_EXPERIMENT,
}


@pytest.mark.usefixtures("workspace")
@pytest.mark.parametrize(
    ("section", "case"), [(section, case) for section in ENTRIES for case in ENTRIES[section]]
)
def test_what_an_entry_cannot_have_is_refused_in_one_line(
    section: str, case: dict[str, Any]
) -> None:
    entry = deepcopy(VALID[section])
    for key, value in case["change"].items():
        change(entry, key, value)
    list_entries(**{section: {"own": entry}})
    with pytest.raises(InputError) as refused:
        load_beyond(load_params())
    assert re.match(
        rf"beyond/params\.yaml: {section}\.own[.:] ?{re.escape(case['says'])}", str(refused.value)
    )


@pytest.mark.usefixtures("workspace")
def test_params_without_a_part_of_a_variant_are_refused_only_where_variants_run() -> None:
    variant = VARIANT | {
        "experiments": ["ai2thor", "paper"],
        "initializers": ["xavier", "mean"],
    }
    list_entries(variants={"own": variant}, graphs={"other": GRAPH_EXPERIMENT})
    raw = yaml.safe_load(paths.PARAMS.read_text(encoding="utf-8"))
    for gone in ("experiments.paper", "initializers.mean"):
        fewer = deepcopy(raw)
        change_all(fewer, {gone: DROP})
        paths.PARAMS.write_text(yaml.safe_dump(fewer, sort_keys=False), encoding="utf-8")
        params = load_params()
        assert load_beyond(params, runs=False).variants.keys() == {"own"}
        with pytest.raises(InputError, match=f"got {gone.partition('.')[2]!r}"):
            load_beyond(params)
    list_entries(graphs={"ai2thor": GRAPH_EXPERIMENT})  # the report cannot have two of a name
    with pytest.raises(InputError, match=r"graphs\.ai2thor"):
        load_beyond(load_params(), runs=False)


# The stage


@pytest.fixture(scope="module")
def experiment(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the first pipeline's outputs for an experiment with
    sizes 1 and 2 and two seeds.
    """
    folder: Path = tmp_path_factory.mktemp("variants")
    stage_run.run_all(folder)
    return folder


@pytest.fixture
def varied(
    experiment: Path, monkeypatch: pytest.MonkeyPatch
) -> Callable[..., tuple[pd.DataFrame, pd.DataFrame]]:
    """A function that runs the stage of a variant; returns its runs and its query breakdown."""
    monkeypatch.chdir(experiment)

    def run(stack: int = 2, **settings: Any) -> tuple[pd.DataFrame, pd.DataFrame]:
        list_entries(
            variants={"own": VARIANT | {"experiments": [stage_run.NAME], "size": 2} | settings}
        )
        params = yaml.safe_load(paths.PARAMS.read_text(encoding="utf-8"))
        params["compute"]["stack"] = stack
        paths.PARAMS.write_text(yaml.safe_dump(params), encoding="utf-8")
        stage_run.run("vary own")
        return VARIANT_RUNS.read(variant="own"), VARIANT_QUERIES.read(variant="own")

    return run


SOFT_ES: dict[str, Any] = {"options": {"soft_es": {"temperature": 0.1}}}
Varied = Callable[..., tuple[pd.DataFrame, pd.DataFrame]]


def test_a_variant_runs_with_what_it_changes_and_the_same_for_any_height_of_stacks(
    varied: Varied,
) -> None:
    changes = {"finetuning.max_epochs": 2, "convergence.margin": 0.0001}
    settings = {"initializers": ["rs", "soft_es"], "changes": changes, **SOFT_ES}
    for one, other in zip(varied(1, **settings), varied(2, **settings), strict=True):
        pd.testing.assert_frame_equal(one, other, check_exact=True)
    runs, answers = varied(**settings)
    assert set(runs["model"]) == set(answers["model"]) == {"rs", "soft_es", "joint"}
    for frame in (runs, answers):
        assert set(frame["experiment"]) == {stage_run.NAME}
        assert set(frame["size"]) == {2}
        assert set(frame["seed"]) == {0, 1}
    assert runs.groupby("model", observed=True)["epoch"].max().to_dict() == {
        "rs": 2,
        "soft_es": 2,
        "joint": 0,
    }
    immediate, same = varied(**settings, finetuned=False)
    assert set(immediate["epoch"]) == {0}
    pd.testing.assert_frame_equal(same, answers)


def test_a_variant_with_words_of_its_own_looks_them_up(varied: Varied) -> None:
    settings = {"initializers": ["es"], "options": {"es": {"k": 3}}, "finetuned": False}
    stored, definitions, phrases = (
        of_model(varied(**settings, changes=changes)[1], "es")["mrr_star"].tolist()
        for changes in ({}, {"words.text": "definition"}, {"words.text": "phrase"})
    )
    assert stored != definitions != phrases != stored


def test_a_variant_that_trains_reads_no_embedding(varied: Varied, experiment: Path) -> None:
    embeddings, away = experiment / "data" / "embeddings", experiment / "away"
    embeddings.rename(away)
    changes = {"embedding.model": "distmult", "embedding.dimension": 8, "training.max_epochs": 5}
    try:
        runs, _ = varied(initializers=["xavier", "es"], finetuned=False, changes=changes)
    finally:
        away.rename(embeddings)
    assert len(runs) == 3 * 2 * 6  # models, seeds, scopes
