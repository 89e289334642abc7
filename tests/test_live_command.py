"""``isi live``: its protocol, pipes and sockets, the signals that end it, and other processes that
change the same home.
"""

import json
import os
import shutil
import signal
import subprocess
import threading
import time
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

import isi
from isi.__main__ import main
from isi.home import choosing
from isi.home.home import Home
from isi.home.stream import answer, prepared_beside, serve
from isi.initializers.api import INITIALIZERS, InitResult, initializer
from isi.initializers.context import InitContext
from tests.environment import CAN_MOUNT, OWN_MOUNTS, PATIENCE, wait_for
from tests.live_processes import COMMAND, connect, lines, piped, socket_of
from tests.small_bundle import random_bundle

#: It has (e0, in, e1), and neither (e0, in, e2) nor (e0, in, e3).
KNOWN = replace(random_bundle(90), words=None, kinds=["object", "place"] * 15)
HISTORY = {"history": True}
#: Requests, and behind => what the answer contains.
CONVERSATION = """
{"tell": [["a", "in", "e1"]], "kind": "place", "id": 1} => {"id": 1, "inserted": ["a"], "seen": 0}
{"tell": {"b": {"in": ["e1", "e2"], "on": "a"}, "c": {"on": "e3"}}} => {"inserted": ["b", "c"]}
{"tell": [["C", "in", "e1"], ["c", "on", "e3"]]} => {"updated": ["c"], "facts": 1, "seen": 1}
{"ask": ["a", "in", null], "top": 1, "id": [2]} => {"id": [2], "query": ["a", "in", "?"]}
{"ask": ["a", "in", null], "top": 1} => {"sure": true, "answers": [{"entity": "e1", "given": true}]}
{"ask": ["a", null, "e1"], "top": 1} => {"answers": [{"entity": "in", "known": true}]}
{"ask": ["e0", "in", null], "new": true, "among": ["e1", "e2"]} => {"answers": [{"entity": "e2"}]}
{"ask": [["a", "in", null], [null, "on", "a"]], "top": 1} => {"results": [{}, {}]}
{"ask": ["A", "in", null]} => {"query": ["a", "in", "?"]}
{"nearest": "a", "top": 2} => {"nearest": [{}, {}]}
{"explain": "a"} => {"explain": {"entity": "a", "kind": "place"}}
{"undo": true} => {"updated": ["c"], "lost": [["c", "in", "e1"]]}
{"move": ["c", "on", "e4"], "instead_of": "e3"} => {"facts": 1, "lost": [["c", "on", "e3"]]}
{"facts": "c"} => {"facts": [{"head": "c", "relation": "on", "tail": "e4", "status": "added"}]}
{"remove": true, "facts": [["b", "in", "e2"]]} => {"lost": [["b", "in", "e2"]]}
{"remove": "b"} => {"removed": ["b"], "lost": [["b", "in", "e1"], ["b", "on", "a"]]}
{"tell": [["e5", "at", "e6"], ["e6", "at", "e5"]]} => {"relations": ["at"], "inserted": []}
{"tell": [["d", "in", "e1", 0.5]], "time": 0} => {"inserted": ["d"]}
{"stale": "30d"} => {"stale": [{"head": "d", "confidence": 0.5}]}
{"history": true, "last": 1} => {"history": [{"verb": "tell", "inserted": ["d"]}]}
"""
#: Requests that are refused, as a client sends them.
BAD = r"""
[]
5
"undo"
no JSON
{"undo": tru
{}
{"id": 1}
{"undo": false}
{"undo": true, "history": true}
{"undo": true, "source": "a\tb"}
{"undo": true, "undo": true}
{"histor": true}
{"compact": true}
{"insert": "e1"}
{"tell": null}
{"tell": "e1 in e2"}
{"tell": [["e1", "in"]]}
{"tell": [["e1", "in", "e99"]], "new": "refuse"}
{"tell": [["e0", "in", "e2"]], "id": 1e999}
{"tell": [["e0", "in", "e2"]], "id": "\ud800"}
{"tell": [["e0", "in", "e2"]], "id": NaN}
{"tell": [["e0", "in", "e2"]], "facts": [["e0", "in", "e3"]]}
{"tell": [["e0", "in", "e2"]], "time": "noon"}
{"tell": [["e0", "in", "e2"]], "time": true}
{"tell": [["e0", "in", "e2"]], "time": 1e300}
{"tell": [["e0", "in", "e2"]], "confidence": 0}
{"tell": [["e0", "in", "e2", "sure"]]}
{"tell": [["x", "beside", "e1"]]}
{"tell": [["e1", "near", "e2"], ["e3", "near", "e4"]], "new": "refuse"}
{"tell": [["x", "in", "e1", 1.5]]}
{"ask": ["e1", null, "e2"], "among": ["e1"]}
{"tell": [], "entities": ["x"]}
{"tell": ["e1 in e2"]}
{"tell": [{"e1": 1, "in": 2, "e2": 3}]}
{"tell": [["x", "in", "e1"]], "kind": {"y": "object"}}
{"tell": 5}
{"tell": [["a\tb", "in", "e1"]]}
{"tell": {"x": {"in": [5]}}}
{"tell": {"x": {"in": "e1"}, "x": {"in": "e2"}}}
{"tell": {"x": "e1"}}
{"tell": [["x", "in", "e1"]], "kind": "robot"}
{"tell": [["x", "in", "e1"]], "initializer": "rs", "options": {"k": 0}}
{"tell": [["x", "in", "e1"]], "seed": -1}
{"remove": "e1"}
{"remove": true, "facts": [["e0", "in", "e2"]]}
{"ask": ["e1", "in"]}
{"ask": [["e1", "in", null], ["e1", "in", "e2"]]}
{"ask": ["e1", "in", null], "top": 0}
{"ask": ["e1", "in", null], "among": ["nobody"]}
{"explain": "e1"}
{"stale": "30"}
{"stale": true}
{"facts": "nobody"}
{"nearest": "e1", "top": 0}
""".strip().splitlines()


@pytest.fixture(scope="module")
def prepared(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A home in which all choices are made."""
    home, folder = Home(KNOWN), tmp_path_factory.mktemp("prepared") / "home"
    home.prepare()
    home.save(folder)
    return folder


@pytest.fixture
def folder(prepared: Path, tmp_path: Path) -> Path:
    return shutil.copytree(prepared, tmp_path / "home")


def answered(folder: Path, requests: bytes) -> list[Any]:
    """The answers of a process to all requests at once."""
    done = subprocess.run(
        [*COMMAND, str(folder)], input=requests, capture_output=True, check=True, timeout=PATIENCE
    )
    assert done.stderr == b""
    return [json.loads(line) for line in done.stdout.splitlines()]


def contains(found: Any, expected: Any) -> bool:
    """Whether an answer has all that is expected; of an object, at least the keys."""
    if isinstance(expected, dict):
        return all(contains(found.get(key), value) for key, value in expected.items())
    if isinstance(expected, list) and len(found) == len(expected):
        return all(map(contains, found, expected))
    return bool(found == expected)


def verbs(folder: Path) -> list[str]:
    with isi.open(folder) as home:
        return [change.verb for change in home.history()]


def test_each_request_has_an_answer(folder: Path) -> None:
    requests, expected = zip(
        *(line.split(" => ") for line in CONVERSATION.strip().splitlines()), strict=True
    )
    answers = answered(folder, "\n".join(requests).encode())
    for request, found, wanted in zip(requests, answers, map(json.loads, expected), strict=True):
        assert contains(found, wanted), (request, found)
    made = "tell tell tell undo move remove remove tell tell"
    assert " ".join(verbs(folder)) == made


def test_a_long_stream_with_malformed_requests_has_an_answer_on_each_line(folder: Path) -> None:
    requests = list[str]()
    for number in range(200):
        told = [[f"thing {number // 4}", "in", f"e{number % 30}"]]
        ask = {"ask": ["e0", "in", None], "top": 1}
        request = ask if number % 4 == 1 else {"tell": told}
        requests += [json.dumps(request), *BAD[number : number + 1]]
    answers = answered(folder, "\n".join(requests).encode())
    refused = [
        request for request, found in zip(requests, answers, strict=True) if "error" in found
    ]
    assert refused == BAD
    assert not [found for found in answers if "internal" in str(found.get("error"))]
    assert verbs(folder) == ["tell"] * 150


@pytest.mark.parametrize("line", [b"", b"\n", b"\xff\xfe\n", b"[" * 9999, b"9" * 9999])
def test_a_line_that_is_no_json_is_refused(line: bytes, folder: Path) -> None:
    assert list(json.loads(answer(isi.open(folder), line))) == ["error"]


def test_an_unexpected_error_is_answered_and_logged_and_changes_nothing(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    registered = {name: INITIALIZERS.get(name) for name in INITIALIZERS.names()}
    monkeypatch.setattr(INITIALIZERS, "_registered", registered)

    @initializer("failing")
    def fail(context: InitContext) -> InitResult:
        raise ZeroDivisionError(f"of {len(context.novel)}\nin two lines")

    home = isi.open(folder)
    request = {"tell": [["a", "in", "e1"]], "initializer": "failing", "id": 7}
    refused = json.loads(answer(home, lines(request)))
    assert refused["id"] == 7
    assert refused["error"].startswith("internal: ZeroDivisionError")
    assert "Traceback" in capsys.readouterr().err
    assert (verbs(folder), home.inserted) == ([], {})
    assert json.loads(answer(home, lines({"tell": [["a", "in", "e1"]]})))["inserted"] == ["a"]


# Pipes


@pytest.mark.parametrize("which", ["stdin", "stdout"])
def test_a_pipe_that_does_not_block_loses_nothing(which: str, folder: Path) -> None:
    requests, into = os.pipe()
    out, answers = os.pipe()
    os.set_blocking(requests if which == "stdin" else answers, False)
    with subprocess.Popen([*COMMAND, str(folder)], stdin=requests, stdout=answers) as process:
        os.close(requests)
        os.close(answers)

        def send() -> None:
            os.write(into, b'{"ask": ["e1", "i')
            time.sleep(0.2)  # a request in two parts
            os.write(into, b'n", null]}\n')
            many = {"ask": [["e1", "in", None]] * 40, "top": 40}
            for _ in range(9):
                os.write(into, lines(many))
            os.close(into)

        sender = threading.Thread(target=send)
        sender.start()
        wait_for(lambda: False, 0.5)  # the pipe of answers is full by then
        with os.fdopen(out, "rb") as read:
            found = [json.loads(line) for line in read]
        sender.join()
    assert process.returncode == 0
    assert len(found) == 10
    assert all("error" not in each for each in found)


@pytest.mark.parametrize("end", ["< /dev/null", "<&-", "< /dev/null >&-"])
def test_an_input_without_requests_or_a_closed_one_ends_the_process(folder: Path, end: str) -> None:
    command = f"{' '.join(COMMAND)} {folder} {end}"
    done = subprocess.run(command, shell=True, capture_output=True, check=False)  # noqa: S602
    assert (done.returncode, done.stdout, done.stderr) == (0, b"", b"")


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT, signal.SIGKILL])
def test_what_was_acknowledged_is_stored_when_a_signal_ends_the_process(
    number: signal.Signals, folder: Path
) -> None:
    with piped(folder) as (process, ask):
        for place in range(5):
            assert ask({"tell": [[f"a {place}", "in", "e1"]]})["facts"] == 1
        os.write(ask.writer.fileno(), lines(*({"tell": [["e0", "in", "e2"]]} for _ in range(9))))
        process.send_signal(number)
        started = time.monotonic()
        out, errors = process.communicate(timeout=PATIENCE)
    assert time.monotonic() - started < 20
    assert process.returncode == (-9 if number == signal.SIGKILL else 0)
    assert errors.count(b"\n") == (number != signal.SIGKILL)
    assert 5 + out.count(b"\n") <= len(verbs(folder)) <= 14


# Sockets


def test_clients_of_a_socket_and_a_command_see_one_home(folder: Path, tmp_path: Path) -> None:
    path = tmp_path / "socket"
    with socket_of(folder, path) as process:
        one, other, verbose = connect(path), connect(path), connect(path)
        assert path.stat().st_mode & 0o077 == 0
        assert one({"tell": [["a", "in", "e1"]]})["inserted"] == ["a"]
        assert other({"ask": ["a", "in", None], "top": 1})["answers"][0]["given"] is True
        other.writer.write(b'{"tell": [["a", ')  # half a request of a client that goes away
        other.writer.close()
        with suppress(ConnectionError):
            verbose.writer.write(b"x" * 2**21 + b"\n")
            verbose.writer.flush()
        with suppress(ConnectionError):  # it is left, since its request is too long
            assert b"error" in verbose.reader.readline()
        main(["tell", "b", "on", "a", "--home", str(folder)])
        assert one({"ask": ["b", "on", None], "top": 1})["answers"][0]["entity"] == "a"
        assert one({"remove": "b"})["removed"] == ["b"]
        assert list(isi.open(folder).inserted) == ["a"]
        process.send_signal(signal.SIGTERM)
        _, errors = process.communicate(timeout=PATIENCE)
    assert (process.returncode, errors.count(b"\n")) == (0, 1)
    assert not path.exists()


def test_a_socket_is_of_one_process_and_a_dead_one_is_taken_over(
    folder: Path, tmp_path: Path
) -> None:
    path = tmp_path / "socket"
    with socket_of(folder, path) as process:
        process.kill()
        process.wait()
    assert path.is_socket()
    with socket_of(folder, path) as process:
        ask = connect(path)
        serving = subprocess.run(
            [*COMMAND, str(folder), "--socket", str(path)], capture_output=True, check=False
        )
        assert (serving.returncode, serving.stderr.count(b"\n")) == (1, 1)
        assert str(path).encode() in serving.stderr
        assert ask(HISTORY) == {"history": []}
        path.unlink()
        with socket_of(folder, path):  # another one, under the name that the first one had
            process.terminate()
            process.wait()
            assert connect(path)(HISTORY) == {"history": []}


def test_a_socket_that_cannot_be_made_is_refused_in_one_line(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("mine", encoding="utf-8")
    for path in (tmp_path / "file", tmp_path / "none" / "socket", tmp_path / ("x" * 200)):
        with pytest.raises(isi.InputError, match=path.name[:20]):
            serve(Home(KNOWN), path)
    assert (tmp_path / "file").read_text(encoding="utf-8") == "mine"


# Choices, and a disk that is read-only


def test_choices_are_made_beside_and_never_in_the_process_that_answers(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    Home(KNOWN).save(tmp_path / "home")
    with isi.open(tmp_path / "home") as home, prepared_beside(home):
        assert home.derived.choices.preparation()
        asked = json.loads(answer(home, lines({"ask": ["e0", "in", None]})))
        assert asked["answers"]
        assert wait_for(lambda: not home.derived.choices.preparation())
        monkeypatch.setattr(choosing, "choose", None)
        told = [
            [f"a {number}", "in", f"e{place}"] for number in range(4) for place in range(number)
        ]
        effect = json.loads(answer(home, lines({"tell": told})))
        assert effect["inserted"] == ["a 1", "a 2", "a 3"]
        assert home.ask("a 2", "in").answers[0].given


@pytest.mark.skipif(not CAN_MOUNT, reason="no file system can be mounted here")
def test_a_read_only_folder_is_asked_and_refuses_changes(folder: Path) -> None:
    with isi.open(folder) as home:
        home.tell([("a", "in", "e1")])
    requests = lines({"ask": ["a", "in", None], "top": 1}, {"undo": True}, {"explain": "a"})
    script = (
        f"mount --bind {folder} {folder} && mount -o remount,bind,ro {folder} && "
        f"exec {' '.join(COMMAND)} {folder}"
    )
    done = subprocess.run(
        [*OWN_MOUNTS, "sh", "-c", script], input=requests, capture_output=True, check=True
    )
    asked, refused, explained = map(json.loads, done.stdout.splitlines())
    assert asked["answers"][0]["entity"] == "e1"
    assert "home.sqlite" in refused["error"]
    assert explained["explain"]["facts"]
    assert done.stderr == b""
