"""``isi``: mistakes are one line, help is quick, and it is installed."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from isi.__main__ import main
from tests.kept import NAMES, edit, small, without_words, written

ROOT = Path(__file__).parent.parent


@pytest.fixture(autouse=True)
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with an embedding, ``home``."""
    monkeypatch.chdir(tmp_path)
    return written(tmp_path / "home", without_words())


def refused(capsys: pytest.CaptureFixture[str], *arguments: str) -> str:
    """The one line with which a command ends, at status other than 0."""
    with pytest.raises(SystemExit) as ended:
        main([*arguments, "--embedding", "home"] if "--embedding" not in arguments else list(arguments))
    out, err = capsys.readouterr()
    assert out == ""
    line = err.strip() or str(ended.value.code)
    assert ended.value.code not in (0, None)
    assert "\n" not in line
    return line


# Mistakes

MISTAKES = {
    ("insert", "stove"):
        r"isi insert: 'stove': expected a --fact, an --inverse-fact or a word vector, and it has none",
    ("insert", "Kettle", "--fact", "atLocation", "kitchen"):
        r"isi insert: NAME: expected a new name: 'kettle' is known",
    ("insert", "a\tb"):
        r"isi insert: NAME: expected text without tabs",
    ("insert", " "):
        r"isi insert: NAME: expected a name, got none",
    ("insert", "x", "--definition", "a\nb"):
        r"isi insert: --definition: expected text without tabs",
    ("insert", "x", "--fact", "atLocation", "kitchn"):
        r"isi insert: --fact: .*got 'kitchn' \(did you mean 'kitchen'\?\)",
    ("insert", "x", "--fact", "hasColour", "bed"):
        r"isi insert: --fact: expected a relation .*'hasAffordance'\)",
    ("insert", "x", "--inverse-fact", "atLocation", "bed"):
        r"isi insert: --inverse-fact: expected a relation",
    ("insert", "x", "--fact", "atLocation"):
        r"isi insert: argument --fact: expected 2 arguments",
    ("insert", "x", "--kind", "rom"):
        r"isi insert: --kind: expected a kind .*\(did you mean 'room'\?\)",
    ("insert", "x", "--initializer", "e", "--fact", "atLocation", "bed"):
        r"isi insert: --initializer: expected one of ",
    ("insert", "x", "--vectors", "none.txt"):
        r"isi insert: none\.txt: expected word vectors",
    ("insert", "x", "--seed", "-1"):
        r"isi insert: argument --seed: expected",
    ("insert", "x", "--fact", "atLocation", "bed", "--out", "."):
        r"isi insert: argument --out: expected a folder by its name, got '\.'",
    ("insert", "x", "--fact", "atLocation", "bed", "--out", "x" * 300):
        r"isi insert: x+\.\.\.x+: File name too long",
    ("nearest", "bed", "--embedding", "x" * 300):
        r"isi nearest: x+\.\.\.x+: File name too long",
    ("nearest", ""):
        r"isi nearest: ENTITY: expected an entity of this embedding, got '' \(there are 'kitchen'",
    ("export", "--embedding", "home", "--format", "turtle", "--out", "."):
        r"isi export: \.: expected the name of a file",
    ("export", "--embedding", "home", "--format", "turtle", "--out", "graph.ttl", "--seed", "1"):
        r"isi export: --seed: expected an experiment",
    ("ask", "kettle"):
        r"isi ask: expected ENTITY RELATION, or --relation",
    ("ask", "kettle", "atLocation", "--tail", "bed"):
        r"isi ask: expected ENTITY RELATION, or --relation",
    ("ask", "kettle", "atLocation", "--head", "bed"):
        r"isi ask: --head: expected it once",
    ("ask", "ketle", "atLocation"):
        r"isi ask: ENTITY: .*did you mean 'kettle'",
    ("ask", "kettle", "located"):
        r"isi ask: RELATION: expected a relation .*'atLocation'",
    ("ask", "kettle", "atLocation", "--top", "0"):
        r"isi ask: argument --top: expected a whole number from 1, got '0'",
    ("nearest", "lamp"):
        r"isi nearest: ENTITY: expected an entity of this embedding, got 'lamp'",
    ("nearest", "bed", "--embedding", "nowhere"):
        r"isi nearest: nowhere: expected the folder of an embedding",
    ("nearest", "bed", "--embedding", "data/kept/ai2thor"):
        r"isi nearest: data/kept/ai2thor: the pipeline has not kept",
    ("explain", "bed"):
        r"isi explain: home: expected an entity that was inserted \(none\), got 'bed'",
    ("frob",):
        r"isi: argument COMMAND: invalid choice: 'frob'",
}  # fmt: skip


@pytest.mark.parametrize("arguments", MISTAKES, ids=" ".join)
def test_a_mistake_is_one_line_and_nothing_is_written(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, arguments: tuple[str, ...]
) -> None:
    assert re.match(MISTAKES[arguments], refused(capsys, *arguments))
    assert [path.name for path in tmp_path.iterdir()] == ["home"]


def test_a_broken_embedding_is_one_line(capsys: pytest.CaptureFixture[str], home: Path) -> None:
    edit(home, lambda about: about.update(family_options={"margin": 2.0}))
    line = refused(capsys, "ask", "bed", "atLocation")
    assert re.match(r"isi ask: home/embedding\.json: family: margin: unknown key", line)


def test_numbers_that_are_too_large_are_not_inserted_among(capsys: pytest.CaptureFixture[str], home: Path) -> None:
    written(home, replace(small(), entities=small().entities * np.float32(1e30)))
    line = refused(capsys, "insert", "stove", "--fact", "atLocation", "kitchen", "--out", "out")
    assert line.startswith("isi insert: --embedding: expected smaller numbers")
    assert not Path("out").exists()


def test_what_others_say_of_an_embedding_does_nothing_to_a_terminal(
    capsys: pytest.CaptureFixture[str], home: Path
) -> None:
    main(["insert", "stove", "--fact", "atLocation", "kitchen", "--embedding", "home", "--out", "home"])
    capsys.readouterr()
    edit(home, lambda about: about["inserted"][0].update(why="\x1b[2J"))
    line = refused(capsys, "explain", "stove")
    assert line.startswith("isi explain: home/embedding.json: inserted.0.why: expected text without")
    assert line.isprintable()


# The command itself


def test_help_imports_no_command_and_nothing_that_is_slow() -> None:
    code = (
        "import sys; from isi.__main__ import main\n"
        "try: main(['--help'])\n"
        "except SystemExit: pass\n"
        "print(sorted({'torch', 'pandas', 'gensim', 'isi.commands.graph'} & set(sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    assert done.stdout.endswith("[]\n")
    assert {"ask", "explain", "export", "graph", "insert", "nearest"} <= set(done.stdout.split())


@pytest.mark.parametrize("command", ["ask", "explain", "insert", "nearest"])
def test_every_command_has_help(capsys: pytest.CaptureFixture[str], command: str) -> None:
    with pytest.raises(SystemExit) as ended:
        main([command, "--help"])
    assert ended.value.code == 0
    assert "--embedding DIR" in capsys.readouterr().out


def test_it_is_installed_as_isi() -> None:
    scripts = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["scripts"]
    assert scripts == {"isi": "isi.__main__:main"}


def test_who_stops_reading_gets_no_traceback(home: Path) -> None:
    command = f"{sys.executable} -m isi nearest bed --embedding {home} | true"  # which reads nothing
    done = subprocess.run(command, shell=True, cwd=ROOT, capture_output=True, text=True, check=False)  # noqa: S602
    assert done.stderr == ""


def test_a_terminal_that_lacks_a_letter_shows_its_number(tmp_path: Path) -> None:
    home = written(tmp_path / "abroad", replace(small(), entity_names=[*NAMES[:-1], "naïve"]))
    command = [sys.executable, "-m", "isi", "nearest", "bed", "--embedding", str(home)]
    ascii_alone = os.environ | {"PYTHONIOENCODING": "ascii"}
    for json, shown in ((), r"na\xefve"), (("--json",), r'"na\u00efve"'):
        done = subprocess.run([*command, *json], cwd=ROOT, env=ascii_alone, capture_output=True, text=True, check=True)
        assert shown in done.stdout


def test_who_interrupts_gets_one_line(monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setattr("isi.commands.nearest.run", lambda _: signal.raise_signal(signal.SIGINT))
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        with pytest.raises(SystemExit) as ended:
            main(["nearest", "bed", "--embedding", "home"])
    finally:
        signal.signal(signal.SIGINT, before)
    assert ended.value.code == 130
    said = "isi nearest: stopped by SIGINT; no file is half-written; run it again\n"
    assert capfd.readouterr() == ("", said)
