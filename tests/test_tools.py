"""The tools around the pipeline: progress, workspaces, comparison of settings, and words."""

import ast
import json
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
import torch
import yaml

from isi.errors import InputError
from isi.evaluation.query_sets import query_sets
from isi.evaluation.ranking import evaluate
from isi.graph.sessions import OUT, TEST, TRAIN, VALID
from isi.graph.words import read_vectors
from isi.sources.triples import shipped_names
from isi.tables import paths
from stages.check_params import load
from stages.grid import GridPoints
from tests.small_graphs import points_of, random_embedding, random_graph
from tools import headline, repro, workspace
from tools.choose_initializers import about, hide, settings_of
from tools.embed_phrases import WORDNET, read

ROOT = Path(__file__).parent.parent


@pytest.mark.parametrize(
    "gone",
    [
        [],
        ["initializers.gaussian", "initializers.mean"],
        ["experiments.transfer", "sources.mp3d"],
    ],
    ids=["nothing", "initializers", "an experiment"],
)
def test_the_quick_grid_fits_params_from_which_something_was_left_out(
    tmp_path: Path, gone: list[str]
) -> None:
    params = yaml.safe_load((ROOT / "params.yaml").read_text(encoding="utf-8"))
    workspace.change_all(params, dict.fromkeys(gone, workspace.DROP))
    dropped = {key.partition(".")[2] for key in gone}
    workspace.change_all(params, workspace.QUICK)
    (tmp_path / "params.yaml").write_text(yaml.safe_dump(params), encoding="utf-8")
    quick = load(tmp_path / "params.yaml")
    assert quick.experiments["ai2thor"].sessions.seeds == 4
    assert set(quick.plots.initializers) <= set(quick.initializers)
    assert set(quick.experiments) == {"paper", "ai2thor", "transfer"} - dropped


@pytest.mark.parametrize(
    ("changes", "meant"),
    [
        ({"initializer.es.k": 4}, "'initializers.es.k'"),
        ({"initializers.ess.k": 4}, "'initializers.es.k'"),
        ({"seed.k": 4}, "seed"),
        ({"experiments.transfr": workspace.DROP}, "'experiments.transfer'"),
        ({"experiments.transfer.sessions.seed": workspace.DROP}, "seeds"),
        ({"experiments.paper_transfer.sessions.seeds": 4}, "paper_transfer"),  # not in a quick run
    ],
)
def test_a_misspelt_key_of_a_workspace_is_refused_and_nothing_is_written(
    tmp_path: Path, changes: dict[str, Any], meant: str
) -> None:
    with pytest.raises(InputError, match=meant):
        workspace.make_checked(tmp_path / "quick", changes)
    assert not (tmp_path / "quick").exists()


def of_run(**novel: float) -> dict[str, Any]:
    """Headline numbers of a run with two experiments."""
    part = {"immediate_mrr": {"novel": novel}, "epochs_to_convergence": {"xavier": 12.0}}
    return {"home": part, "away": part}


def test_the_headline_says_what_changed_since_the_last_run_with_other_numbers(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / ".dvc").mkdir()
    (tmp_path / "reports").mkdir()

    def changes(metrics: dict[str, Any]) -> list[list[str]]:
        (tmp_path / "reports/metrics.json").write_text(json.dumps(metrics), encoding="utf-8")
        headline.main(tmp_path / "reports")
        lines = map(str.split, capsys.readouterr().out.splitlines())
        return [
            line for line in lines if line and line[0] in ("xavier", "es") and line[1][0] in "+-"
        ]

    assert changes(of_run(xavier=47.5, es=64.81)) == []
    # of each experiment, without the model that stayed or its epochs
    two = [["es", "-0.76"], ["es", "-0.76"]]
    assert changes(of_run(xavier=47.5, es=64.05)) == two
    assert changes(of_run(xavier=47.5, es=64.05)) == two  # nothing ran
    assert changes(of_run(xavier=47.5)) == []  # what is in one alone
    assert changes(of_run(xavier=47.75)) == [["xavier", "+0.25"]] * 2
    (tmp_path / headline.KEPT).write_text("[{", encoding="utf-8")
    assert changes(of_run(xavier=48.0)) == []
    # the other is gone
    alone = {"immediate_mrr": {"novel": {"xavier": 49.0}}}
    assert changes({"home": alone}) == [["xavier", "+1.00"]]


def test_a_params_file_that_was_edited_in_a_workspace_stays(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(workspace, "COPIED", ("dvc.yaml",))
    (tmp_path / ".dvc" / "tmp").mkdir(parents=True)
    path = tmp_path / "params.yaml"

    def indicators(**changes: Any) -> tuple[int, bool]:
        """k of ES, and whether a line says that the file stays."""
        capsys.readouterr()
        workspace.make_checked(
            tmp_path, {f"initializers.es.{key}": value for key, value in changes.items()}
        )
        return load(path).initializers["es"]["k"], bool(capsys.readouterr().out)

    assert indicators(k=4) == (4, False)
    assert indicators() == (8, False)
    path.write_text(
        path.read_text(encoding="utf-8").replace("candidates: 30", "candidates: 29"),
        encoding="utf-8",
    )
    assert indicators() == (8, True)
    assert indicators(k=5) == (5, True)
    before = path.read_bytes()
    with pytest.raises(InputError, match=r"initializers\.es\.kk"):
        indicators(kk=5)
    assert path.read_bytes() == before
    assert load(path).initializers["ers"]["candidates"] == 29
    path.unlink()
    with pytest.raises(InputError, match=r"initializers\.es\.kk"):
        indicators(kk=5)
    assert indicators() == (8, False)


def test_the_second_way_of_computing_shares_no_code_with_the_library() -> None:
    """It also shares no code with the other tools."""
    nodes = list(ast.walk(ast.parse((ROOT / "tools/verify.py").read_text(encoding="utf-8"))))
    imported = {
        alias.name for node in nodes if isinstance(node, ast.Import) for alias in node.names
    }
    imported |= {str(node.module) for node in nodes if isinstance(node, ast.ImportFrom)}
    packages = {module.split(".")[0] for module in imported}
    assert not packages & {"isi", "stages", "tools", "tests", "torch", "importlib"}


def test_progress_counts_the_stages_that_targets_name() -> None:
    names = ["explore@virtualhome", "explore@behavior", "report_beyond"]
    one = ["beyond/dvc.yaml:explore@behavior"]
    assert repro.wanted(names, ["beyond/dvc.yaml", "--force"]) == names
    assert repro.wanted(names, one) == ["explore@behavior"]
    assert repro.wanted(names, ["beyond/dvc.yaml:explore"]) == names[:2]


@pytest.mark.parametrize(
    ("line", "stage", "runs"),
    [
        ("Running stage 'train_joint@paper':", "train_joint@paper", True),
        ("Running stage 'beyond/dvc.yaml:vary@insert_triples_0':", "vary@insert_triples_0", True),
        ("Stage 'mine@ai2thor' didn't change, skipping", "mine@ai2thor", False),
        (
            "Stage 'beyond/dvc.yaml:vary@insert_triples_0' didn't change, skipping",
            "vary@insert_triples_0",
            False,
        ),
        (
            "Stage 'beyond/dvc.yaml:vary@a' is cached - skipping run, checking out outputs",
            "vary@a",
            False,
        ),
        ("> exec python -m stages.vary insert_triples_0", None, None),
        ("Updating lock file 'beyond/dvc.lock'", None, None),
    ],
)
def test_what_dvc_says_names_a_stage_of_either_pipeline(
    line: str, stage: str | None, runs: bool | None
) -> None:
    match = repro.BEGINS.match(line)
    assert (match and (match["stage"] or match["same"])) == stage
    assert (match and bool(match["stage"])) == runs


#: As DVC writes it.
LOCK = """schema: '2.0'
stages:
  mine@here:
    cmd: mine
    deps:
    - path: a
      hash: md5
      md5: d58d856d185b4819303cce492ad3cc65
      size: 4428
  report:
    cmd: report
"""


@pytest.mark.parametrize(
    ("before", "left", "whole"),
    [
        (LOCK, 0, False),
        (LOCK, 30, False),
        (LOCK, LOCK.index("  report"), False),
        (LOCK, len(LOCK), True),
        (None, 0, False),
        (None, 30, False),
        (None, len(LOCK), True),
    ],
)
def test_a_lock_file_that_was_cut_short_is_as_before_and_a_whole_one_stays(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    before: str | None,
    left: int,
    whole: bool,
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / ".dvc/tmp").mkdir(parents=True)
    path, now = tmp_path / "dvc.lock", LOCK.replace("4428", "4429")
    if before:
        path.write_text(before, encoding="utf-8")
    repro.LockFile(Path("dvc.lock")).back_up()
    path.write_text(now[:left], encoding="utf-8")
    for _ in range(2):
        repro.LockFile(Path("dvc.lock")).mend()
        expected = now[:left] if whole else before
        assert (path.read_text(encoding="utf-8") if path.exists() else None) == expected
    assert ("was cut short" in capsys.readouterr().out) is not whole
    assert not list((tmp_path / ".dvc/tmp").iterdir())


ENTITIES, RELATIONS = 20, 3


def hidden(draw: int = 0) -> tuple[GridPoints, GridPoints]:
    points = points_of(random_graph(ENTITIES, RELATIONS, 140), 3, [0, 1, 2])
    return points, hide(points, 4, draw, 0, 0.5)


def test_known_entities_are_hidden_and_neither_novel_ones_nor_test_triples_have_a_part() -> None:
    points, pseudo = hidden()
    for model in range(3):
        known = points.session(0).trained()[model].nonzero().flatten().tolist()
        assert set(pseudo.novel[model].tolist()) <= set(known)
        touched = np.isin(points.graph.triples[:, [0, 2]], points.novel[model]).any(1)
        assert (pseudo.splits[model][touched] == OUT).all()
    assert (pseudo.splits[points.splits == TEST] == OUT).all()
    kept = pseudo.splits != OUT
    assert (pseudo.splits[kept] == points.splits[kept]).all()
    assert set(pseudo.splits[kept].tolist()) == {TRAIN, VALID}
    assert not (pseudo.session(0).entities.gather(1, pseudo.novel_ids)).any()
    assert (pseudo.novel != hidden(draw=1)[1].novel).any()


def test_half_of_the_training_triples_of_hidden_entities_are_insert_triples() -> None:
    _, pseudo = hidden()
    for model, place, triple in pseudo.insert_triples.tolist():
        head, _, tail = pseudo.graph.triples[triple].tolist()
        assert pseudo.splits[model, triple] == TRAIN
        assert pseudo.novel[model, place] in (head, tail)
    number, ends = (
        pd.DataFrame(pseudo.insert_triples).groupby([0, 1]).size(),
        pseudo.graph.triples[:, [0, 2]].numpy(),
    )
    for (model, place), count in number.items():  # type: ignore[misc]
        of_entity = (ends == pseudo.novel[model, place]).any(1)
        usable = (
            of_entity
            & (np.isin(ends, pseudo.novel[model]).sum(1) == 1)
            & (pseudo.splits[model] == TRAIN)
        )
        assert count == max(1, usable.sum() // 2)


def test_half_of_the_queries_for_entities_are_about_the_novel_one() -> None:
    _, pseudo = hidden()
    queries = query_sets(pseudo.session(1), pseudo.novel_ids, pseudo.insert_mask)["novel"]
    with_novel = about(queries, pseudo.novel_ids)
    theta = random_embedding(3, ENTITIES, RELATIONS, 8)
    measured = evaluate(theta, {"about": with_novel})["about"].measures[:, 1]
    rows = with_novel.rows
    assert rows is not None
    torch.testing.assert_close(rows.entity_weight.sum(1), torch.ones(3))
    for model in range(3):
        novel = set(pseudo.novel[model].tolist())
        heads, _, tails = (ids[model].tolist() for ids in rows.ids)
        for place, (head, tail) in enumerate(zip(heads, tails, strict=True)):
            weights = rows.entity_weight[model, [place, place + len(heads)]]
            queried = bool(queries.rows.entity_weight[model, place] > 0)  # type: ignore[union-attr]
            assert (weights > 0).tolist() == [queried and tail in novel, queried and head in novel]
    assert ((measured > 0) & (measured < 1)).all()


def test_the_shipped_phrases_of_wordnet_are_whole_and_have_vectors_of_unit_length() -> None:
    table = pd.read_csv(WORDNET, keep_default_na=False, dtype=str)
    assert table["phrase"].is_monotonic_increasing
    assert table["phrase"].is_unique
    assert ((table["definition"] != "") == (table["synset"] != "")).all()
    published = pd.read_csv(paths.PUBLISHED_PHRASES)
    assert {*shipped_names()["phrase"], *published["phrase"]} <= set(table["phrase"])
    words = read_vectors(paths.shipped_vectors("wordnet"))
    assert words.index_to_key == list(read(WORDNET).index)
    assert (abs((words.vectors**2).sum(1) - 1) < 1e-5).all()


def test_options_in_params_are_compared_first_and_once() -> None:
    settings = settings_of(["mean", "soft_rs"], {"soft_rs": {"temperature": 0.05}, "es": {"k": 8}})
    assert settings[:2] == [("mean", {}), ("soft_rs", {"temperature": 0.05})]
    compared = [options["temperature"] for _, options in settings[1:]]
    assert compared == [0.05, 0.01, 0.02, 0.03, 0.07, 0.1, 0.2]
