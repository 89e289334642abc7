"""The scripts of examples/ run as they stand, on files of the pipeline."""

import contextlib
import io
from contextlib import chdir
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from tests import small

SCRIPT = Path(__file__).parent.parent / "examples" / "read_runs.py"


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    made: Path = tmp_path_factory.mktemp("examples")
    small.run_all(made)
    with chdir(made):
        small.run(f"insert {small.NAME} iu")
    return made


def shown(folder: Path, text: str) -> str:
    out = io.StringIO()
    with chdir(folder), contextlib.redirect_stdout(out):
        exec(compile(text, str(SCRIPT), "exec"), {})  # noqa: S102
    return out.getvalue()


def test_runs_are_read_and_compared_in_pairs(folder: Path) -> None:
    text, named = SCRIPT.read_text(encoding="utf-8"), '"ai2thor", "es", "xavier"'
    assert named in text
    printed = shown(folder, text.replace(named, f'"{small.NAME}", "rs", "iu"'))
    tables = {name: pd.read_parquet(folder / f"data/runs/{small.NAME}/{name}.parquet") for name in ("rs", "iu")}
    by_run = [
        {(row.size_, row.seed): row.mrr_star for row in table.rename(columns={"size": "size_"}).itertuples()
         if row.epoch == 0 and row.scope == "novel"}
        for table in tables.values()
    ]  # fmt: skip
    apart = np.array([100 * (by_run[0][run] - by_run[1][run]) for run in by_run[0]])
    half = 1.96 * apart.std(ddof=1) / np.sqrt(len(apart))
    assert f"rs - iu: {apart.mean():+.2f} ± {half:.2f} points over {len(apart)} runs" in printed
    for column in tables["rs"].columns:
        assert f"# | `{column}`" in text or f"`{column}`, " in text or f", `{column}`" in text


def test_without_runs_a_line_says_what_makes_them(tmp_path: Path) -> None:
    with pytest.raises(SystemExit, match="make quick"):
        shown(tmp_path, SCRIPT.read_text(encoding="utf-8"))
