"""Experiments under other conditions: what is told, what params change, and the same runs as the first pipeline's."""

from __future__ import annotations

import shutil
import sys
from collections import Counter
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
import torch
import yaml

from isi.analyses.query_breakdown import break_down
from isi.analyses.variants import (
    VARIANT_QUERIES,
    VARIANT_RUNS,
    Models,
    Variant,
    VariantTask,
    at_most,
    changed,
    run_variant,
    train_models,
)
from isi.errors import InputError
from isi.experiment.grid import no_triples
from isi.experiment.insert import InsertConfig, insert_stack
from isi.experiment.store import JOINT, THETA0
from isi.experiment.train import TrainConfig, evaluate_stack
from isi.graph.graph import ENTITIES, TRIPLES
from isi.graph.sampling import INSERT_TRIPLES, NOVEL, SPLITS
from isi.graph.sessions import SPLIT_NAMES
from isi.graph.words import WORD_VECTORS
from isi.params import load as load_params
from isi.params import load_beyond
from isi.tables import io, paths
from stages.vary import vary
from tests.small_graphs import as_stored, points_of
from tests.small_grid import GRAPH as DRAWN
from tests.small_grid import INITIALIZERS, LEARNING, MARGIN, OPTIMIZER, SAMPLED, SEEDS, WORDS

ROOT = Path(__file__).parent.parent
MADE = "an_earlier_stage"
GRAPH = as_stored(DRAWN)
NAMES = ("xavier", "es", "rs")


def rows_of(triples: np.ndarray) -> list[tuple[int, ...]]:
    return [tuple(row) for row in triples.tolist()]


# What is told


@pytest.mark.parametrize("steps", [1, 2])
def test_so_many_of_each_entity_are_told_and_the_fewer_are_part_of_the_more(steps: int) -> None:
    points = points_of(GRAPH, 2, SEEDS, steps=steps)
    told = points.insert_triples
    number = Counter(row[:3] for row in rows_of(told))
    assert max(number.values()) > 3
    fewer: set[tuple[int, ...]] = set()
    for most in range(6):
        found = rows_of(at_most(points, most, 0))
        assert Counter(row[:3] for row in found) == Counter({slot: min(most, n) for slot, n in number.items()})
        assert found == [row for row in rows_of(told) if row in set(found)]  # in their order
        assert fewer <= set(found)
        fewer = set(found)
    assert rows_of(at_most(points, None, 0)) == rows_of(told)


def test_none_are_told_of_those_who_have_none() -> None:
    points = points_of(GRAPH, 2, SEEDS)
    for most in (0, 3, None):
        assert at_most(replace(points, insert_triples=no_triples()), most, 0).shape == (0, 4)


def test_what_is_told_is_drawn_anew_for_each_entity_and_root() -> None:
    points = points_of(GRAPH, 2, SEEDS)
    told = points.insert_triples
    one, other = (rows_of(at_most(points, 1, root)) for root in (0, 1))
    first = {row[:3]: row for row in reversed(rows_of(told))}
    assert one != other
    assert 0 < sum(row != first[row[:3]] for row in one) < len(one)  # neither always nor never the first


def test_each_session_draws_what_is_told_for_itself() -> None:
    rows = np.array([(session, 0, 0, triple) for session in (1, 2) for triple in range(12)])
    points = replace(points_of(GRAPH, 1, [0], steps=2), insert_triples=rows)
    first, second = ({row[3] for row in rows_of(at_most(points, 6, 0)) if row[0] == session} for session in (1, 2))
    assert len(first) == len(second) == 6
    assert first != second


def test_the_same_is_told_of_an_entity_whatever_stands_beside_its_cell() -> None:
    points = points_of(GRAPH, 2, SEEDS, steps=2)
    together = [(row[0], SEEDS[row[1]], *row[2:]) for row in rows_of(at_most(points, 2, 0))]
    alone = []
    for seed in SEEDS:
        own = points_of(GRAPH, 2, [seed], steps=2)
        alone += [(row[0], seed, *row[2:]) for row in rows_of(at_most(own, 2, 0))]
    assert sorted(together) == sorted(alone)


# What params change


def test_values_change_at_dotted_keys_and_nothing_else_does() -> None:
    before = load_params()
    after = changed(before, {"training.max_epochs": 9, "words.text": "phrase", "initializers.es.k": 3})
    assert (after.training.max_epochs, after.words.text, after.initializers["es"]) == (9, "phrase", {"k": 3})
    assert before == load_params()  # to its depths
    assert changed(after, {"training.max_epochs": 200, "words.text": "definition", "initializers.es.k": 8}) == before


@pytest.mark.parametrize(
    "dotted", ["seed", "training", "trainings.rate", "seed.more", "training.rate", "words.text.more", "sweep.size"]
)
def test_a_change_of_what_may_not_be_changed_is_refused_by_its_key(dotted: str) -> None:
    with pytest.raises(InputError) as refused:
        changed(load_params(), {"words.text": "phrase", dotted: 1})
    assert dotted.split(".")[0] in str(refused.value)


VARIANT: dict[str, Any] = {
    "title": "own", "group": "causes", "experiments": ["ai2thor"], "initializers": ["xavier", "es"], "size": 5,
    "seeds": 2,
}  # fmt: skip


@pytest.mark.parametrize(
    ("keys", "trains", "changes_words"),
    [
        ([], False, False),
        (["finetuning.learning_rate", "convergence.margin", "initializers.es.k"], False, False),
        (["embedding.model"], True, False),
        (["models.transe.margin"], True, False),
        (["negatives.mode"], True, False),
        (["finetuning.learning_rate", "training.weight_decay"], True, False),
        (["words.text"], False, True),
        (["words.text", "training.batch_size"], True, True),
        (["training_log.own", "wordless.own"], False, False),
    ],
)
def test_a_variant_trains_and_looks_words_up_where_it_changes_what_that_depends_on(
    keys: list[str], trains: bool, changes_words: bool
) -> None:
    variant = Variant(**VARIANT, changes=dict.fromkeys(keys, 1))
    assert (variant.trains, variant.changes_words) == (trains, changes_words)


# The runs


def stored(size: int = 2) -> Models:
    """Θ⁰ and the joint models, as the first pipeline trains them."""
    return train_models(points_of(GRAPH, size, SEEDS), LEARNING)


def task(start: Models | TrainConfig, most: int | None = None, size: int = 2) -> VariantTask:
    configs = {name: InsertConfig(name, INITIALIZERS[name], 0, SAMPLED, OPTIMIZER, MARGIN) for name in NAMES}
    return points_of(GRAPH, size, SEEDS), start, WORDS, configs, most


def of_model(frame: pd.DataFrame, model: str) -> pd.DataFrame:
    return frame[frame["model"] == model].drop(columns="model").reset_index(drop=True)


def test_from_stored_embeddings_the_runs_are_those_of_the_first_pipeline() -> None:
    theta0, joint = stored()
    points, *_, configs, _ = variant_task = task((theta0, joint))
    runs, answers = run_variant(*variant_task)
    measured = evaluate_stack(points, joint)
    target = {(1, scope): measured[measured["scope"] == scope].set_index("seed")["mrr_star"].loc[SEEDS].to_numpy(
        copy=True) for scope in ("all", "novel_heldout")}  # fmt: skip
    inserted = {name: insert_stack(points, theta0, WORDS, target, config) for name, config in configs.items()}
    assert set(runs["model"]) == {*NAMES, "joint"}
    pd.testing.assert_frame_equal(of_model(runs, "joint"), measured.reset_index(drop=True))
    for name, result in inserted.items():
        pd.testing.assert_frame_equal(of_model(runs, name), result.runs.reset_index(drop=True))
    same = break_down(points, theta0, joint[0], {name: result.vectors for name, result in inserted.items()})
    pd.testing.assert_frame_equal(answers.reset_index(drop=True), same.reset_index(drop=True))


def test_embeddings_of_its_own_are_those_that_the_first_pipeline_would_train() -> None:
    for trained, read in zip(run_variant(*task(LEARNING)), run_variant(*task(stored())), strict=True):
        pd.testing.assert_frame_equal(trained, read)


def test_the_joint_model_is_the_same_whatever_the_size() -> None:
    own = [of_model(run_variant(*task(LEARNING, size=size))[0], "joint") for size in (1, 2)]
    one, two = (rows[rows["scope"] == "all"].set_index("seed") for rows in own)
    assert one["mrr_star"].tolist() == two["mrr_star"].tolist()


def test_queries_are_the_same_whatever_the_number_of_insert_triples() -> None:
    start = stored()
    everything, nothing, one = (run_variant(*task(start, most)) for most in (None, 0, 1))
    groups = ["model", "seed", "scope", "filter", "relation", "hidden", "novel", "queries", "observations"]
    for runs, answers in (nothing, one):
        pd.testing.assert_frame_equal(answers[groups], everything[1][groups])
        for model in ("xavier", "es", "joint"):  # who do not look at insert triples
            pd.testing.assert_frame_equal(of_model(answers, model), of_model(everything[1], model))
        assert not np.allclose(of_model(answers, "rs")["mrr_star"], of_model(everything[1], "rs")["mrr_star"])
        pd.testing.assert_frame_equal(of_model(runs, "joint"), of_model(everything[0], "joint"))


# What is listed


def test_what_ships_is_of_experiments_and_initializers_that_there_are(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(ROOT)
    variants = load_beyond(load_params()).variants.values()
    assert {variant.group for variant in variants} == {"baselines", "embeddings", "insert_triples", "words", "causes"}
    limits = [variant.max_insert_triples for variant in variants if variant.group == "insert_triples"]
    assert limits == [0, 1, 2, 3, 5, None]


def test_without_a_second_pipeline_there_are_no_variants(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    params = load_params()
    monkeypatch.chdir(tmp_path)
    assert load_beyond(params).variants == {}


@pytest.fixture
def workspace(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with the pipelines and the params."""
    for path in (paths.PARAMS, paths.PIPELINE, paths.BEYOND_PARAMS, paths.BEYOND_PIPELINE):
        (tmp_path / path).parent.mkdir(exist_ok=True)
        shutil.copy(ROOT / path, tmp_path / path)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def list_variants(**listed: Mapping[str, Any]) -> None:
    paths.BEYOND_PARAMS.write_text(yaml.safe_dump({"variants": listed}), encoding="utf-8")


@pytest.mark.usefixtures("workspace")
@pytest.mark.parametrize(
    ("wrong", "line"),
    [
        ({"experiments": ["published", "there"]},
         "experiments: expected names among ai2thor, transfer, published, got 'there'"),
        ({"initializers": ["es", "soft_es"]}, "initializers: expected names among xavier, iu, es, "),
        ({"options": {"soft_e": {}}, "initializers": ["soft_e"]}, "options.soft_e: expected one of "),
        ({"options": {"soft_es": {"temper": 1.0}}}, "options.soft_es.temper: unknown key; did you mean 'temperature'?"),
        ({"changes": {"training.weight_deca": 0.1}}, "changes.training.weight_deca: unknown key; did you mean "),
        ({"changes": {"negatives.mode": "drawn"}}, "changes.negatives.mode: Input should be 'sampled' or 'expected'"),
        ({"changes": {"sessions.valid": 0.2}}, "changes.sessions.valid: expected keys below "),
        ({"group": "baseline"}, "group: Input should be 'baselines', "),
        ({"seed": 3}, "seed: unknown key"),
    ],
)  # fmt: skip
def test_what_a_variant_cannot_have_is_refused_in_one_line(wrong: dict[str, Any], line: str) -> None:
    list_variants(sound=VARIANT, own=VARIANT | wrong)
    with pytest.raises(InputError) as refused:
        load_beyond(load_params())
    assert str(refused.value).startswith(f"beyond/params.yaml: variants.own.{line}")


@pytest.mark.usefixtures("workspace")
def test_options_of_its_own_make_an_initializer_known_to_a_variant() -> None:
    list_variants(own=VARIANT | {"options": {"soft_es": {"temperature": 0.1}}, "initializers": ["soft_es"]})
    load_beyond(load_params())


@pytest.mark.usefixtures("workspace")
def test_params_without_variants_are_refused_in_one_line() -> None:
    paths.BEYOND_PARAMS.write_text("variant: {}\n", encoding="utf-8")
    with pytest.raises(InputError, match=r"^beyond/params\.yaml: "):
        load_beyond(load_params())


# The stage


@pytest.fixture
def home(workspace: Path) -> Path:
    """The same, with what the first pipeline leaves of an experiment: of sizes 1 and 2, with four seeds."""
    (workspace / paths.RAW).parent.mkdir()
    (workspace / paths.RAW).symlink_to(ROOT / paths.RAW)
    phrases = ["mug", "plate", "fork", "sofa", "lamp", "bed", "sink", "stove", "apple", "bread", "knife", "desk",
               "kitchen", "cut"]  # fmt: skip
    entities = pd.DataFrame({"entity": GRAPH.entities, "kind": [str(kind) for kind in GRAPH.kinds.tolist()],
                             "source": "home", "phrase": phrases})  # fmt: skip
    triples = pd.DataFrame(
        [(GRAPH.entities[h], GRAPH.relations[r], GRAPH.entities[t], count, "home")
         for (h, r, t), count in zip(GRAPH.triples.tolist(), GRAPH.counts.tolist(), strict=True)],
        columns=["head", "relation", "tail", "count", "source"],
    )  # fmt: skip
    drawn = {size: points_of(GRAPH, size, SEEDS) for size in (1, 2)}
    splits = [(seed, triple, SPLIT_NAMES[code]) for seed, codes in zip(SEEDS, drawn[2].splits.tolist(), strict=True)
              for triple, code in enumerate(codes)]  # fmt: skip
    novel = [(size, seed, entity, 1) for size, points in drawn.items()
             for seed, ((*ids,),) in zip(SEEDS, points.novel.tolist(), strict=True) for entity in ids]  # fmt: skip
    told = [(size, SEEDS[model], points.novel[model, 0, place], triple, 1) for size, points in drawn.items()
            for _, model, place, triple in points.insert_triples.tolist()]  # fmt: skip
    for path, frame, schema in (
        (ENTITIES.path(experiment="home"), entities, ENTITIES), (TRIPLES.path(experiment="home"), triples, TRIPLES),
        (SPLITS.path(experiment="home"), pd.DataFrame(splits, columns=["seed", "triple", "split"]), SPLITS),
        (NOVEL.path(experiment="home"), pd.DataFrame(novel, columns=["size", "seed", "entity", "session"]), NOVEL),
        (INSERT_TRIPLES.path(experiment="home"),
         pd.DataFrame(told, columns=["size", "seed", "entity", "triple", "session"]),
         INSERT_TRIPLES),
    ):  # fmt: skip
        schema.write_file(path, frame, MADE)
    WORD_VECTORS.write({"vectors": torch.from_numpy(WORDS)}, MADE, experiment="home")
    sessions, at = (
        (drawn[2].session(0), drawn[2].last_session),
        (THETA0.path(experiment="home", size=2), JOINT.path(experiment="home")),
    )
    theta0, (joint,) = stored()
    for path, one, session in zip(at, (theta0, joint), sessions, strict=True):
        stack = {"entity": one.stack.entity, "relation": one.stack.relation, "known": session.entities,
                 "seed": torch.tensor(SEEDS)}  # fmt: skip
        io.write_tensors(path, stack, MADE)
    return workspace


def ran(monkeypatch: pytest.MonkeyPatch, stack: int, **how: Any) -> tuple[pd.DataFrame, pd.DataFrame]:
    """What the stage writes of a variant of the experiment, in stacks of a height: runs, and what was asked."""
    list_variants(own=VARIANT | {"experiments": ["home"], "size": 2, "seeds": 3} | how)
    params = yaml.safe_load((ROOT / paths.PARAMS).read_text(encoding="utf-8"))
    params["experiments"]["home"] = params["experiments"]["published"] | {"title": "home"}
    params["compute"] |= {"workers": 1, "stack": stack}
    paths.PARAMS.write_text(yaml.safe_dump(params), encoding="utf-8")
    monkeypatch.setattr(sys, "argv", ["vary", "own"])
    vary()
    runs = VARIANT_RUNS.read(variant="own")
    return runs, VARIANT_QUERIES.read(variant="own")


@pytest.mark.usefixtures("home")
def test_a_variant_runs_with_what_it_changes_and_the_same_for_any_height_of_stacks(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    changes = {"finetuning.max_epochs": 2, "convergence.margin": 0.0001}
    how = {"initializers": ["rs", "soft_es"], "options": {"soft_es": {"temperature": 0.1}}, "changes": changes}
    for one, other in zip(ran(monkeypatch, 1, **how), ran(monkeypatch, 3, **how), strict=True):
        pd.testing.assert_frame_equal(one, other, check_exact=True)
    runs, asked = ran(monkeypatch, 2, **how)
    assert set(runs["model"]) == set(asked["model"]) == {"rs", "soft_es", "joint"}
    for frame in (runs, asked):
        assert set(frame["experiment"]) == {"home"}
        assert set(frame["size"]) == {2}
        assert set(frame["seed"]) == {0, 1, 2}
    assert runs.groupby("model", observed=True)["epoch"].max().to_dict() == {"rs": 2, "soft_es": 2, "joint": 0}
    at_once, same = ran(monkeypatch, 3, **how, finetuned=False)
    assert set(at_once["epoch"]) == {0}
    pd.testing.assert_frame_equal(same, asked)


@pytest.mark.usefixtures("home")
def test_a_variant_that_is_followed_runs_all_epochs_even_where_it_has_converged(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    how = {"initializers": ["es", "soft_es"], "options": {"soft_es": {"temperature": 0.1}},
           "changes": {"finetuning.max_epochs": 2, "convergence.margin": 0.99}}  # fmt: skip
    epochs = [ran(monkeypatch, 3, **how, full_curves=full)[0] for full in (False, True)]
    stopped, whole = (runs.groupby("model", observed=True)["epoch"].max().to_dict() for runs in epochs)
    assert stopped == {"es": 0, "soft_es": 0, "joint": 0}
    assert whole == {"es": 2, "soft_es": 2, "joint": 0}


@pytest.mark.usefixtures("home")
def test_a_variant_that_tells_nothing_changes_those_who_use_insert_triples(monkeypatch: pytest.MonkeyPatch) -> None:
    how = {"initializers": ["es", "rs"], "options": {"rs": {"k": 3}}, "finetuned": False}
    found = [ran(monkeypatch, 4, **how, max_insert_triples=most)[1] for most in (None, 0)]
    (es, rs), (es0, rs0) = ([of_model(frame, name)["mrr_star"] for name in ("es", "rs")] for frame in found)
    assert es.tolist() == es0.tolist()
    assert rs.tolist() != rs0.tolist()


@pytest.mark.usefixtures("home")
def test_a_variant_with_words_of_its_own_looks_them_up(monkeypatch: pytest.MonkeyPatch) -> None:
    how = {"initializers": ["es"], "options": {"es": {"k": 3}}, "finetuned": False}
    stored, definitions, phrases = (
        of_model(ran(monkeypatch, 4, **how, changes=changes)[1], "es")["mrr_star"].tolist()
        for changes in ({}, {"words.text": "definition"}, {"words.text": "phrase"})
    )
    assert stored != definitions != phrases != stored


def test_a_variant_that_trains_reads_no_embedding(home: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    shutil.rmtree(home / THETA0.path(experiment="home", size=2).parent.parent)
    changes = {"embedding.model": "distmult", "embedding.dimension": 8, "training.max_epochs": 5}
    runs, _ = ran(monkeypatch, 4, initializers=["xavier", "es"], finetuned=False, changes=changes)
    assert len(runs) == 3 * 3 * 5  # models, seeds, scopes
