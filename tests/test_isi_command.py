"""``isi``: help is quick, it is installed, and who interrupts it gets one line."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest

from isi.__main__ import main
from tests.small_bundle import NAMES, small, without_words, written

ROOT = Path(__file__).parent.parent


@pytest.fixture(autouse=True)
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with an embedding, ``home``."""
    monkeypatch.chdir(tmp_path)
    return written(tmp_path / "home", without_words())


# The command itself


@pytest.mark.parametrize("command", [[], ["insert"], ["ask"], ["nearest"], ["explain"]])
def test_help_loads_nothing_that_is_slow(command: list[str]) -> None:
    code = (
        f"import sys; from isi.__main__ import main; main({[*command, '--help']})\n"
        "print(sorted({'torch', 'pandas', 'gensim', 'isi.cli.graph'} & set(sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    assert done.stdout.endswith("[]\n")
    shown = {"--embedding"} if command else {"ask:", "explain:", "export:", "graph:", "insert:", "nearest:"}
    assert shown <= set(done.stdout.split())


def test_a_closed_pipe_gives_no_traceback(home: Path) -> None:
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


def test_an_interrupt_gives_one_line(monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setattr("isi.cli.entity.open_folder", lambda _: signal.raise_signal(signal.SIGINT))
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        with pytest.raises(SystemExit) as ended:
            main(["nearest", "bed", "--embedding", "home"])
    finally:
        signal.signal(signal.SIGINT, before)
    assert ended.value.code == 130
    said = "isi nearest: stopped by SIGINT; no file is half-written; run it again\n"
    assert capfd.readouterr() == ("", said)


def test_another_python_than_that_of_the_environment_says_so_in_one_line() -> None:
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    command = [sys.executable, "-S", "-m", "isi", "check"]
    ended = subprocess.run(command, env=environment, cwd=ROOT, capture_output=True, text=True, check=False)
    assert ended.returncode == 1
    assert re.fullmatch(r"isi: \S+ lacks the package \w+: activate \.venv, or use its `isi`\n", ended.stderr)
