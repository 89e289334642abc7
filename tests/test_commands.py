"""The command ``isi`` on a home: sessions of commands and what they print, its help, and its exit
status.
"""

import os
import re
import shlex
import signal
import sqlite3
import subprocess
import sys
from contextlib import closing
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from isi.__main__ import main
from isi.cli import COMMANDS, lines
from tests.small_bundle import NAMES, home_of, small, worded

ROOT = Path(__file__).parent.parent
#: Commands, and behind => what each prints, with | between the parts, and behind ! what it does
#: not; [1] is an exit status.
SESSIONS = {
    "what is told is inserted, seen again, and undone": """
tell hob atLocation kitchen => hob is inserted as object | hob atLocation ?: kitchen (given)
tell hob atLocation kitchen => facts seen again: 1 ! inserted
tell hob hasAffordance 'turn on' => updated: hob | facts added: 1
ask hob hasAffordance => turn on (given)
undo => facts removed: 1
undo => seen once less
undo => removed: hob
undo => [1] undo
history => tell (undone) | hob atLocation kitchen
""",
    "several facts are one change": """
tell --fact hob atLocation kitchen --fact bed atLocation kitchen => hob is inserted
tell --fact hob near bed --fact bed near hob => new relations: near | facts added: 2
ask hob near => bed (given)
tell --entity jug => jug is inserted
undo => removed: jug
tell --entity mug => [1] 'mug'
tell hob beside bed => [1] 'beside' | two facts
tell hob => [1] --entity 'hob'
tell hob atLocation => [1] HEAD RELATION TAIL
tell => [1] --from FILE
""",
    "insert and observe say which names are new": """
observe --fact hob hasAffordance 'turn on' => [1] hob
observe --fact hob hasAffordance 'turn on' --new => inserted: hob
insert hob --fact atLocation kitchen => [1] known
insert hob --fact atLocation kitchen --upsert => updated: hob | facts added: 1 ! inserted
insert stove --fact atLocation kitchen --upsert => stove is inserted
insert Kettle --fact atLocation bedroom => [1] --new
insert Kettle --fact atLocation bedroom --new => Kettle is inserted
""",
    "a fact of training is retracted, brought back and moved": """
remove --fact kettle atLocation kitchen => facts removed: 1
ask kettle atLocation => bedroom ! kitchen
undo => facts added: 1
ask kettle atLocation => kitchen (known)
move kettle atLocation bedroom --source camera => facts added: 1 | facts removed: 1
ask kettle atLocation => bedroom (given) ! kitchen
ask kettle --tail kitchen => hasAffordance ! atLocation
move kettle atLocation bed --instead-of kitchen => [1] holds
move kettle atLocation bedroom => facts seen again: 1
history => move | kettle atLocation kitchen | camera
""",
    "an inserted entity is removed, and comes back": """
tell hob atLocation kitchen => inserted
remove hob => removed: hob
ask hob atLocation => [1] 'hob'
undo => inserted: hob
ask hob atLocation => kitchen (given)
remove bed => [1] inserted (hob)
""",
    "each part of a triple is asked for": """
ask kettle atLocation => kitchen (known)
ask --head kettle --relation atLocation => kitchen (known)
ask --relation 'at location' --tail bedroom => bed (known)
ask kettle --tail kitchen => atLocation (known)
ask kettle atLocation --new => bedroom ! kitchen
ask kettle atLocation --among bedroom bed => bedroom ! kitchen
explain Gas-Hob => [1] 'Gas-Hob'
tell 'gas hob' atLocation kitchen => inserted
explain Gas-Hob => 'gas hob' | gas hob atLocation kitchen
ask kettle atLocation --among nowhere => [1] 'nowhere'
ask KETTLE 'at location' => 'kettle' | 'atLocation' | kitchen (known)
ask kettle => [1] relation
ask kettle atLocation --from queries.csv => [1] --from
ask => [1] --from
""",
    "facts have a time, a source and a confidence": """
tell hob atLocation kitchen --time 2026-01-01T00:00Z --source camera --confidence 0.5 => inserted
history --stale 30d => hob atLocation kitchen | 2026-01-01T00:00:00Z | camera ! kettle
history --stale 5 => [1] --stale
tell hob atLocation kitchen --confidence 2 => [1] confidence
tell hob atLocation kitchen --time noon => [1] time
""",
    "a dry run writes nothing": """
tell hob atLocation kitchen --dry-run => hob is inserted | nothing is written
remove --fact kettle atLocation kitchen --dry-run => facts removed: 1 | nothing is written
ask hob atLocation => [1] hob
history => changes: none
""",
    "files of facts and of questions": """
tell --from facts.csv --from more.csv --json => "inserted": [ "hob", "stove" ] | "facts": 3 | \\
"known": 1
tell --from facts.csv --from more.csv => facts seen again: 4 ! added
ask --from queries.csv => bed atLocation ? bedroom (known) | \\
? hasAffordance turn on kettle (known) | \\
bed ? bedroom atLocation (known)
ask --from queries.csv --json => "query": [ "bed", "atLocation", "?" ] | \\
"query": [ "bed", "?", "bedroom" ]
ask --from broken.csv => [1] broken.csv: line 3
""",
    "a fact about a new entity has two or three parts, before and behind its name": """
insert hob --fact atLocation kitchen --dry-run => hob is inserted as object | \\
hob atLocation ?: kitchen (given)
insert hob --fact hob atLocation kitchen --dry-run => hob atLocation ?: kitchen (given)
insert --fact hob atLocation kitchen hob => hob atLocation ?: kitchen (given)
explain hob --json => "facts": [ [ "hob", "atLocation", "kitchen" ] ]
insert hall --inverse-fact kettle atLocation --dry-run => hall is inserted as room
insert --fact kettle atLocation hall hall => hall is inserted as room | \\
? atLocation hall: kettle (given)
explain hall --json => "facts": [ [ "kettle", "atLocation", "hall" ] ]
""",
    "an insertion is reported as JSON, in sentences, and with why": """
tell hob atLocation kitchen --dry-run --json => "inserted": [ "hob" ] | "kind": "object" | \\
"initializer": "map" | \\
"entity": "kitchen", "rank": 1 | "probability": null
tell hob atLocation kitchen --dry-run --verbose => hob is inserted | by map | word vector
tell hob atLocation kitchen --dry-run => hob is inserted ! by map
tell hob atLocation kitchen --initializer rs --set k=1 --json => "weight": 1.0 ! "weight": 0.5
tell stove atLocation kitchen --initializer rs --set k=2 --json => "weight": 0.5 ! "weight": 1.0
explain stove --verbose => stove: object, inserted by rs | \\
without the fact stove atLocation kitchen | \\
without the indicator kettle
""",
}
#: Files that sessions read.
FILES = {
    "facts.csv": "stove,atLocation,kitchen\nkettle,atLocation,kitchen\nkettle,atLocation,bedroom\n",
    "more.csv": "hob,atLocation,kitchen\n",
    "queries.csv": "bed,atLocation,?\n?,hasAffordance,turn on\nbed,,bedroom\n",
    "broken.csv": "bed,atLocation,?\nnobody,atLocation,?\n",
}


@pytest.fixture(autouse=True)
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A home of the small bundle in the current folder, whose words are of a file that has one
    further name.
    """
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("ISI_HOME", raising=False)
    for name, rows in FILES.items():
        Path(name).write_text(f"head,relation,tail\n{rows}", encoding="utf-8")
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


@pytest.mark.parametrize("session", SESSIONS)
def test_a_session(session: str, capsys: pytest.CaptureFixture[str]) -> None:
    for line in SESSIONS[session].replace("\\\n", "").strip().splitlines():
        typed, expected = line.split(" => ")
        expected, _, absent = expected.partition("! ")
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
    for option in ("--home", "--embedding"):
        assert printed(capsys, *question, option, "other") == by_default
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
        "print({'torch', 'pandas', 'gensim', 'isi.live.embedding'} & set(sys.modules))"
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
    monkeypatch.setattr("isi.cli.entity.open_home", lambda _: signal.raise_signal(signal.SIGINT))
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
