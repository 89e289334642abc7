"""What a user meets who mines a file that is not what its reader reads: one line of the command, to the letter."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest
import yaml

from isi.__main__ import main
from isi.sources import procthor_houses, triples_with_ids
from isi.tables import paths
from stages.mine import mine
from tests.fuzz import formats
from tests.said import LOG, Case, files_of
from tests.said.__main__ import TABLE, table
from tests.said.every import CASES

ROOT = Path(__file__).parent.parent
ALL = [pytest.param(case, id=f"{group}: {case.what}") for group, cases in CASES.items() for case in cases]


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with the pipeline, in which commands run; what a package has of all houses is not read."""
    (tmp_path / paths.PIPELINE).write_bytes((ROOT / paths.PIPELINE).read_bytes())
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(procthor_houses, "recorded", lambda _scenes: formats.RECORDED)
    monkeypatch.setattr(procthor_houses, "asset_types", lambda: formats.ASSETS)
    triples_with_ids.shipped_names.cache_clear()
    return tmp_path


@pytest.mark.parametrize("case", ALL)
def test_a_mistake_in_a_file_is_told_in_one_line(
    folder: Path, case: Case, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    for name, content in files_of(case).items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(content)
    section = {**formats.FORMATS[case.format].section, **case.settings}
    if case.format.startswith("words"):
        command = ["python -m isi", "graph", "log.csv"]
        (folder / "log.csv").write_text(LOG, encoding="utf-8")
        params = yaml.safe_load((ROOT / paths.PARAMS).read_text(encoding="utf-8"))
        params["words"] = {"source": next(iter(case.files)), "text": "phrase", "sha256": None}
    else:
        command = ["python -m stages.mine", "fuzz"]
        params = {"seed": 0, "sources": {"fuzz": section}}
    (folder / paths.PARAMS).write_text(yaml.safe_dump(params), encoding="utf-8")
    before = {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}
    monkeypatch.setattr(sys, "argv", command)
    with pytest.raises(SystemExit) as ended:
        main(command[1:]) if "isi" in command[0] else mine()
    printed = capsys.readouterr()
    line = ended.value.code if isinstance(ended.value.code, str) else printed.err.rstrip("\n")
    whose = "isi graph: " if "isi" in command[0] else "mine: "
    within = "" if whose != "mine: " or case.said.startswith("sources.fuzz.") else "sources.fuzz: "
    assert line == whose + within + case.said
    assert ended.value.code not in (None, 0)
    assert len(line) < 300
    assert printed.out == ""
    assert {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()} == before


def test_what_the_documentation_lists_is_what_is_said() -> None:
    """After a change: ``python -m tests.said``, then ``make readme``."""
    assert TABLE.read_text(encoding="utf-8") == table()
