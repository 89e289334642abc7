"""Mining a file of the wrong format ends in one line that names the file and the place."""

import sys
from pathlib import Path
from typing import Any

import pytest
import yaml

from isi.__main__ import main
from isi.sources import triples
from isi.tables import paths
from stages.mine import mine
from stages.pipeline import PIPELINE
from tests.mistakes import LOG, Case, assert_names, files_of
from tests.mistakes.files import FILE_CASES
from tools.fuzz import formats

ROOT = Path(__file__).parent.parent


def parsed(path: Path) -> Any:
    return yaml.safe_load((ROOT / path).read_text(encoding="utf-8"))


#: The pipeline with the stage alone, which is parsed faster than the whole.
MINE_ALONE = yaml.safe_dump({"stages": {"mine": parsed(PIPELINE)["stages"]["mine"]}})


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with the pipeline, which is the current folder."""
    (tmp_path / PIPELINE).write_text(MINE_ALONE, encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    triples.shipped_names.cache_clear()
    return tmp_path


@pytest.mark.parametrize(
    "case", [pytest.param(case, id=f"{case.format}: {case.what}") for case in FILE_CASES]
)
def test_a_mistake_in_a_file_ends_in_one_line_and_nothing_is_written(
    folder: Path, case: Case, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    for name, content in files_of(case).items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(content)
    section = {**formats.FORMATS[case.format].section, **case.settings}
    params = parsed(paths.PARAMS)
    if case.format.startswith("words"):
        command = ["python -m isi", "train", "log.csv", "--vectors", next(iter(case.files))]
        command += ["--out", "out", "--dimension", "4"]
        (folder / "log.csv").write_text(LOG, encoding="utf-8")
    else:
        command = ["python -m stages.mine", "fuzz"]
        params["sources"]["fuzz"] = section
    (folder / paths.PARAMS).write_text(yaml.safe_dump(params), encoding="utf-8")
    before = {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}
    monkeypatch.setattr(sys, "argv", command)
    with pytest.raises(SystemExit) as ended:
        main(command[1:]) if "isi" in command[0] else mine()
    printed = capsys.readouterr()
    assert ended.value.code not in (None, 0)
    assert_names(
        ended.value.code if isinstance(ended.value.code, str) else printed.err.rstrip("\n"),
        case.names,
    )
    assert printed.out == ""
    assert {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()} == before
