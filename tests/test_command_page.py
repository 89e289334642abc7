"""docs/command.md: its commands run as they stand, and it names the files, families and commands that there are."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import numpy as np
import pytest

from isi.__main__ import main
from isi.bundle.folder import ManifestFile
from isi.cli import COMMANDS
from tests.small_bundle import BETWEEN, NAMES, RELATIONS, VECTORS, files, written

PAGE = (Path(__file__).parent.parent / "docs" / "command.md").read_text(encoding="utf-8")


def test_its_commands_run_as_they_stand(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("mine").mkdir()
    for name, listed in (("entities", NAMES), ("relations", BETWEEN)):
        Path("mine", f"{name}.txt").write_text("\n".join(listed) + "\n", encoding="utf-8")
    np.savez("mine/tables.npz", entities=np.array(VECTORS, float), relations=np.array(RELATIONS, float))
    lines = re.findall(r"^\$ isi (.+)$", PAGE, re.MULTILINE)
    assert lines
    for line in lines:
        main(shlex.split(line))


def test_it_lists_the_files_of_a_folder(tmp_path: Path) -> None:
    section = PAGE.partition("## The folder of a bundle")[2].partition("## ")[0]
    assert set(re.findall(r"^\| `([\w.]+)` \|", section, re.MULTILINE)) == set(files(written(tmp_path / "one")))
    assert "format and version" in section
    assert {"format", "version"} <= set(ManifestFile.model_fields)


def test_it_lists_the_commands_about_embeddings() -> None:
    assert set(re.findall(r"`isi ([a-z]+)", PAGE)) == set(COMMANDS)
