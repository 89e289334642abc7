"""``isi continual``: what it prints about a folder and a benchmark."""

import json
from pathlib import Path

import pytest

from isi.__main__ import main

FILES = {
    "0/train.txt": "cup\tin\thall\n",
    "0/valid.txt": "cup\tin\tden\n",
    "0/test.txt": "cup\tin\tbath\n",
    "1/train.txt": "cup\tin\tattic\n",
    "1/valid.txt": "",
    "1/test.txt": "",
}


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    for name, text in FILES.items():
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(text, encoding="utf-8")
    return tmp_path


def test_a_folder_is_described(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    main(["continual", str(folder)])
    assert [line.split() for line in capsys.readouterr().out.splitlines()][2:] == [
        ["0", "4", "4", "1", "1", "1", "1", "1"],
        ["1", "5", "1", "1", "0", "1", "0", "0"],
        ["percent", "of", "queries", "that", "a", "fault", "touches:"],
        ["fault", "test", "0"],  # test 1 has no queries
        ["validation", "facts", "unfiltered", "50"],
        ["later", "entities", "50"],
        ["later", "facts", "0"],
        ["validated", "on", "test", "100"],
    ]


def test_json_has_null_where_there_are_no_queries(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    main(["continual", str(folder), "--json"])
    rows = json.loads(capsys.readouterr().out)["percent_of_queries_that_a_fault_touches"]
    expected = {"fault": "validation facts unfiltered", "test 0": 50.0, "test 1": None}
    assert rows[0] == expected


def test_a_name_of_no_benchmark_is_refused() -> None:
    with pytest.raises(SystemExit, match="NAME: expected one of ENTITY"):
        main(["continual", "ENTIY"])


def test_outside_a_checkout_the_missing_tables_are_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SystemExit, match="snapshots: cannot be read"):
        main(["continual", "ENTITY"])
