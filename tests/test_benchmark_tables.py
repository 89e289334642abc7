"""The tables of ``make benchmark``: which run wrote each, and what is computed from them."""

from pathlib import Path

import pandas as pd
import pytest

from tools import benchmarks
from tools.benchmarks import large, recorded, run_of, runs_in_words

FOLDER = benchmarks.BENCHMARKS
RESULTS = {
    "datetime": "2026-11-28T09:05:00.123456+00:00",
    "commit_info": {"id": "34d34e88" + 32 * "0", "dirty": False},
    "machine_info": {
        "cpu": {"brand_raw": "AMD EPYC"},
        "cores": 2,
        "system": "Linux",
        "python_version": "3.11.7",
        "isi": "0.2.0",
        "versions": {"torch": "2.13.0"},
    },
}


def test_every_table_of_a_run_is_recorded_and_the_sentences_agree() -> None:
    runs = pd.read_csv(FOLDER / "runs.csv", keep_default_na=False)
    assert (FOLDER / "machine.md").read_text(encoding="utf-8") == runs_in_words(runs)
    written = {name for name in benchmarks.GROUPS if (FOLDER / f"{name}.csv").exists()}
    assert written == set(runs["table"])


def test_what_a_large_graph_takes_is_computed_from_the_tables() -> None:
    shown = pd.read_csv(FOLDER / "large.csv")
    pd.testing.assert_frame_equal(large(), shown, check_dtype=False)


def test_a_run_replaces_the_record_of_the_tables_that_it_wrote() -> None:
    run = run_of(RESULTS)
    assert run == {
        "date": "28 November 2026",
        "isi": "0.2.0",
        "commit": "34d34e88",
        "machine": "AMD EPYC, 2 cores, Linux; Python 3.11.7, torch 2.13.0",
    }
    before = pd.DataFrame(
        [
            {"table": "growth", **run, "date": "1 May 2026"},
            {"table": "insert", **run, "date": "1 May 2026"},
        ]
    )
    runs = recorded(run, ["live", "growth"], before)
    assert list(zip(runs["table"], runs["date"], strict=True)) == [
        ("growth", "28 November 2026"),
        ("insert", "1 May 2026"),
        ("live", "28 November 2026"),
    ]
    assert runs_in_words(runs).splitlines()[0].startswith("- growth, live: one run on 28 November")
    assert runs_in_words(runs[runs["table"] != "insert"]).startswith("- All tables: one run on 28")


def test_changes_that_no_commit_has_are_said() -> None:
    changed = RESULTS | {"commit_info": {"id": "34d34e88", "dirty": True}}
    assert run_of(changed)["commit"] == "34d34e88 with changes"


@pytest.mark.parametrize("missing", ["growth", "insert"])
def test_estimates_need_the_tables_of_smaller_graphs(tmp_path: Path, missing: str) -> None:
    for name in {"growth", "insert"} - {missing}:
        (tmp_path / f"{name}.csv").write_bytes((FOLDER / f"{name}.csv").read_bytes())
    with pytest.raises(FileNotFoundError, match=missing):
        large(tmp_path)


def test_estimates_by_hand(tmp_path: Path) -> None:
    """A step of 2,048 triples costs 2.048 s among a million entities, and as much more as there
    are more of them.
    """
    tables = {
        "growth": "entities,batches as,µs per observation\n500000,lists,500\n1000000,lists,1000\n",
        "insert": 'known entities,ms,peak MiB\n"1,000,000",70,100\n"4,600,000","5,500","4,096"\n',
    }
    for name, text in tables.items():
        (tmp_path / f"{name}.csv").write_text(text, encoding="utf-8")
    made = large(tmp_path)
    assert list(made["figure"]) == [
        "3.7 GB",
        "45 GB",
        "9.4 s",
        "26 hours",
        "5.5 s, 4.0 GiB",
    ]
