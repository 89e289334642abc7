"""The command ``isi`` on a home: sessions of commands and what they print, its help, and its exit
status.
"""

import os
import re
import shlex
import shutil
import signal
import sqlite3
import subprocess
import sys
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

import isi
from isi.__main__ import main
from isi.cli import COMMANDS, lines
from tests.small_bundle import NAMES, home_of, small, worded

ROOT = Path(__file__).parent.parent
EXAMPLES = ROOT / "examples"
SESSIONS = yaml.safe_load((ROOT / "tests/sessions.yaml").read_text(encoding="utf-8"))


@pytest.fixture(autouse=True)
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A home of the small bundle in the current folder, whose words are of a file that has one
    further name.
    """
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("ISI_HOME", raising=False)
    return home_of(tmp_path / "home", worded(tmp_path, jug=[0.8, 0.6, 0]))


def ran(capsys: pytest.CaptureFixture[str], arguments: list[str]) -> tuple[int, str]:
    """The exit status of a command, and what it printed."""
    try:
        main(arguments)
    except SystemExit as ended:
        out, err = capsys.readouterr()
        assert out == ""
        is_line = isinstance(ended.code, str)
        return (1, str(ended.code)) if is_line else (int(ended.code or 0), err)
    out, err = capsys.readouterr()
    assert err == ""
    return 0, out


def printed(capsys: pytest.CaptureFixture[str], *arguments: str) -> str:
    status, out = ran(capsys, list(arguments))
    assert status == 0, out
    return out


def lay_out(session: dict[str, Any]) -> None:
    """Write the files of a session."""
    if session.get("from") == "examples":
        for path in EXAMPLES.glob("home*.csv"):
            shutil.copy(path, ".")
    for name, content in session.get("files", {}).items():
        Path(name).parent.mkdir(exist_ok=True)
        Path(name).write_text(content, encoding="utf-8")


def test_the_folder_of_the_user_is_meant_by_a_tilde_that_no_shell_expands(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("HOME", str(tmp_path / "me"))
    printed(capsys, "save", "~/copy")
    monkeypatch.setenv("ISI_HOME", "~/copy")
    for options in ([], ["--home=~/copy"], ["--home", "~/copy"]):
        assert "kitchen" in printed(capsys, "ask", "kettle", "atLocation", *options)
    with isi.open("~/copy") as home:
        home.save("~/another")
    assert {path.name for path in (tmp_path / "me").iterdir()} == {"copy", "another"}
    assert not Path("~").exists()


@pytest.mark.parametrize("title", SESSIONS)
def test_a_session(title: str, capsys: pytest.CaptureFixture[str]) -> None:
    lay_out(SESSIONS[title])
    for line in SESSIONS[title]["lines"].replace("\\\n", "").strip().splitlines():
        typed, expected = line.split(" => ")
        expected, _, absent = " ".join(expected.split()).partition("! ")
        status, expected = (1, expected[4:]) if expected.startswith("[1]") else (0, expected)
        ended, text = ran(capsys, shlex.split(typed))
        assert (ended, text.count("\n") == 0) == (status, status == 1), f"{line}\n{text}"
        text = " ".join(text.split())
        missing = [part for part in expected.split(" | ") if part.strip() not in text]
        assert not missing, f"{line}\n{text}"
        assert not absent or absent.strip() not in text, f"{line}\n{text}"


# What commands read and write


def test_a_home_is_named_by_an_option_the_environment_or_the_folder(
    home: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    question = ["ask", "kettle", "atLocation"]
    by_default = printed(capsys, *question)
    home.rename("other")
    assert "isi train" in ran(capsys, question)[1]
    assert printed(capsys, *question, "--home", "other") == by_default
    monkeypatch.setenv("ISI_HOME", "other")
    assert printed(capsys, *question) == by_default
    monkeypatch.setenv("ISI_HOME", "nowhere")
    assert "nowhere" in ran(capsys, question)[1]


def test_any_tool_reads_what_holds_from_the_database(
    home: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    moment = ["--time", "2026-01-01T02:00+02:00", "--source", "camera", "--confidence", "0.5"]
    printed(capsys, "tell", "hob", "atLocation", "kitchen", *moment)
    printed(capsys, "remove", "--fact", "kettle", "atLocation", "kitchen")
    with closing(sqlite3.connect(home / "home.sqlite")) as database:
        now = database.execute("SELECT * FROM now WHERE tail = 'kitchen'").fetchall()
        history = database.execute("SELECT verb, effect, head, entity FROM history").fetchall()
    utc = "2026-01-01T00:00:00Z"
    assert now == [("hob", "atLocation", "kitchen", "added", 1, 0.5, utc, utc, "camera")]
    assert history == [
        ("train", None, None, None),
        ("tell", "inserted", None, "hob"),
        ("tell", "added", "hob", None),
        ("remove", "retracted", "kettle", None),
    ]


def test_what_is_unlikely_is_said_not_to_be_known(capsys: pytest.CaptureFixture[str]) -> None:
    """Equal scores have the share of known answers as probability: a few of a hundred."""
    names = [f"thing {number}" for number in range(10)]
    dull = small(
        entities=np.ones((10, 4), np.float32),
        entity_names=names,
        kinds=[""] * 10,
        phrases=names,
        triples=np.array([(0, 0, 1), (2, 0, 3), (4, 1, 5)]),
        words=None,
    )
    home_of(Path("dull"), dull)
    assert "do not know" in printed(capsys, "ask", "thing 7", "atLocation", "--home", "dull")
    assert "do not know" not in printed(capsys, "ask", "thing 0", "atLocation", "--home", "dull")


# The command itself


def test_text_has_a_line_for_each_key_and_tables_without_empty_columns() -> None:
    answer = {
        "the_query": ("a", "in", "?"),
        "share": 0.12345,
        "no_words": None,
        "is_known": True,
        "names": ["b", "c"],
        "rows": [
            {"entity": "b", "weight": None, "cosine": 1.0},
            {"entity": "long", "weight": None, "cosine": None},
        ],
        "parts": [{"of": ("a", "on", "?"), "rows": [{"x": 1}]}],
        "counts": {"c": 3},
    }
    text = """
the query: a in ?
share: 0.123
no words: –
is known: yes
names: b, c
rows:
  entity  cosine
  b       1
  long    –
parts:
  of: a on ?
  rows:
    x
    1
counts:
  c: 3
"""
    assert list(lines(answer)) == text.strip().splitlines()


def test_help_fits_a_terminal_and_loads_nothing_that_is_slow(
    capsys: pytest.CaptureFixture[str],
) -> None:
    about_homes = [name for name, (module, _) in COMMANDS.items() if "entity" in module]
    code = (
        "import sys; from isi.__main__ import main\n"
        f"for command in {[[], ['train'], ['live'], *([name] for name in about_homes)]}:\n"
        "    main([*command, '--help'])\n"
        "print({'torch', 'pandas', 'gensim', 'isi.home.home'} & set(sys.modules))"
    )
    command = [sys.executable, "-c", code]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True)
    assert done.stdout.endswith("set()\n")
    assert printed(capsys, "--help").count("\n") <= 24
    for name in COMMANDS:
        assert printed(capsys, name, "--help").startswith(f"Usage: isi {name}")


def test_a_closed_pipe_gives_no_traceback(home: Path) -> None:
    ask = shlex.join([sys.executable, "-m", "isi", "ask", "bed", "atLocation", "--home", str(home)])
    command = f"{ask} | true"  # which reads nothing
    done = subprocess.run(  # noqa: S602
        command, shell=True, cwd=ROOT, capture_output=True, text=True, check=False
    )
    assert done.stderr == ""


def test_a_terminal_that_lacks_a_letter_shows_its_number(tmp_path: Path) -> None:
    home = home_of(tmp_path / "abroad", replace(small(), entity_names=[*NAMES[:-1], "naïve"]))
    command = ["ask", "bed", "hasAffordance", "--home", str(home)]
    code = f"from isi.__main__ import main; main({command}); main({[*command, '--json']})"
    environment = os.environ | {"PYTHONIOENCODING": "ascii", "PYTHONPATH": str(ROOT)}
    done = subprocess.run(
        [sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=True
    )
    assert r"na\xefve" in done.stdout
    assert r'"na\u00efve"' in done.stdout


def test_an_interrupt_gives_one_line(
    monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("isi.cli.entity.home_in", lambda _: signal.raise_signal(signal.SIGINT))
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        with pytest.raises(SystemExit) as ended:
            main(["ask", "bed", "atLocation"])
    finally:
        signal.signal(signal.SIGINT, before)
    assert ended.value.code == 130
    out, line = capfd.readouterr()
    assert (out, line.count("\n")) == ("", 1)
    assert "isi ask: stopped by SIGINT" in line


def test_another_python_than_that_of_the_environment_says_so_in_one_line() -> None:
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    command = [sys.executable, "-S", "-m", "isi", "history"]
    ended = subprocess.run(
        command, env=environment, cwd=ROOT, capture_output=True, text=True, check=False
    )
    assert ended.returncode == 1
    assert re.fullmatch(
        r"isi: .+ lacks the package \w+: activate \.venv, or use its `isi`\n", ended.stderr
    )
