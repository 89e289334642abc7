"""The README and docs/: tables and numbers are current, links lead to existing targets, and the code runs."""

import re
import shlex
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from isi.__main__ import main
from tests.documented import blocks, commands
from tests.small_bundle import BETWEEN, NAMES, RELATIONS, VECTORS, written
from tools import docs

PAGES = [*docs.pages(), *(docs.ROOT / name for name in ("CONTRIBUTING.md", "CHANGELOG.md"))]
LINK = re.compile(r"\]\(([^)#\s]*)(?:#([^)\s]+))?\)")
HEADING = re.compile(r"^#+ (.+)$", re.MULTILINE)

each_page = pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)


@each_page
def test_what_pages_show_is_what_was_made(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    assert docs.filled(text) == text, "make readme"


@each_page
def test_links_lead_somewhere(page: Path) -> None:
    for path, anchor in LINK.findall(page.read_text(encoding="utf-8")):
        if path.startswith("https://"):
            continue
        target = page.parent / path if path else page
        assert target.exists(), path
        if anchor:
            assert anchor in {slug(heading) for heading in HEADING.findall(target.read_text(encoding="utf-8"))}, anchor


def slug(heading: str) -> str:
    """The anchor of a heading, as forges build it."""
    return re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-")


@pytest.mark.parametrize("of_pykeen", [False, True])
@pytest.mark.parametrize("page", ["insert.md", "insert_reference.md"])
def test_code_runs_as_it_stands(page: str, of_pykeen: bool, capsys: pytest.CaptureFixture[str]) -> None:
    if of_pykeen:
        pytest.importorskip("pykeen")
    left: dict[str, Any] = {}
    for place, block in enumerate(block for block in blocks(page, "python") if ("pykeen" in block) == of_pykeen):
        exec(compile(block, f"block {place}", "exec"), left)  # noqa: S102
    if of_pykeen:
        larger = left["larger" if page == "insert.md" else "model"]
        assert larger.num_entities == left["more" if page == "insert.md" else "factory"].num_entities > 132
        if page == "insert.md":
            parts = left["UMLS"]().factory_dict.values()
            facts = (triple for part in parts for triple in part.triples)
            right = {tail for head, relation, tail in facts if (head, relation) == ("antibiotic", "treats")}
            shown, answers = set(blocks(page, "text")[0].split()), list(left["answers"].tail_label)
            assert shown <= right
            assert len(right.intersection(answers[:5])) >= 3
            assert len(shown.intersection(answers[:10])) >= 3  # the vectors of a model differ between machines
    else:
        assert left["done"].entities[:5].tobytes() == left["entities"].tobytes()
        assert capsys.readouterr().out


def test_commands_about_entities_run_as_they_stand(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    written(tmp_path / "data" / "final_models" / "ai2thor")
    monkeypatch.chdir(tmp_path)
    shown = [line for line in commands("insert.md") if line.startswith("isi ")]
    assert len(shown) == 5
    for line in shown:
        main(shlex.split(line)[1:])
        assert capsys.readouterr().out


def test_commands_of_the_reference_run_as_they_stand(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("mine").mkdir()
    for name, listed in (("entities", NAMES), ("relations", BETWEEN)):
        Path("mine", f"{name}.txt").write_text("\n".join(listed) + "\n", encoding="utf-8")
    np.savez("mine/tables.npz", entities=np.array(VECTORS, float), relations=np.array(RELATIONS, float))
    lines = re.findall(r"^\$ isi (.+)$", (docs.ROOT / "docs/command.md").read_text("utf-8"), re.MULTILINE)
    assert lines
    for line in lines:
        main(shlex.split(line))
