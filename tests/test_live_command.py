"""``isi live``: the protocol, clients of a socket, processes that are killed, and two processes on one folder."""

import asyncio
import json
import os
import random
import signal
import subprocess
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import isi
from isi.bundle.journal import text_of
from isi.bundle.stream import VERBS, answer, serve
from tests.environment import PATIENCE
from tests.live_processes import COMMAND, Client, connect, lines, socket_of
from tests.small_live import KNOWN, assert_same, chosen, live_of, seen


def written(folder: Path) -> Path:
    """A folder with the bundle of test_live, and a journal with its choices."""
    live_of().save(folder)
    (folder / "journal.jsonl").write_text(text_of(chosen()), encoding="utf-8")
    return folder


def answered(folder: Path, *requests: Any) -> list[dict[str, Any]]:
    """The answers of a process to all requests at once."""
    done = subprocess.run(
        [*COMMAND, str(folder)], input=lines(*requests), capture_output=True, check=True, timeout=PATIENCE
    )
    assert done.stderr == b""
    return [json.loads(line) for line in done.stdout.splitlines()]


@pytest.fixture
def home(tmp_path: Path) -> Path:
    return written(tmp_path / "home")


def test_each_request_has_an_answer(home: Path) -> None:
    requests: list[dict[str, Any]] = [
        {"insert": "new a", "facts": [["new a", "in", "e1"]], "kind": "place", "id": 1},
        {"insert": {"new b": {"in": ["e1", "e2"], "on": "new a"}, "new c": {"on": "e3"}}, "id": "two"},
        {"observe": [["new c", "in", "e1"], ["new c", "on", "e3"], ["e1", "on", "e1"]]},
        {"ask": ["new a", "in", None], "top": 3, "id": {"any": ["JSON"]}},
        {"ask": ["new a", None, "e1"]},
        {"nearest": "new c", "top": 2},
        {"interference": True},
        {"interference": ["new c"]},
        {"undo": True},
        {"remove": True, "facts": [["new b", "in", "e2"]]},
        {"remove": "new b"},
        {"history": True},
    ]
    (inserted, two, observed, asked, related, near, all_, one, undone, fact, removed, history) = answered(
        home, *requests
    )
    assert (inserted["id"], inserted["inserted"], inserted["known"]) == (1, ["new a"], 0)
    assert (two["id"], two["inserted"], two["updated"]) == ("two", ["new b", "new c"], ["new a"])
    assert (observed["updated"], observed["known"]) == (["new c"], 1)
    assert asked["query"] == ["new a", "in", "?"]
    assert [len(asked["answers"]), asked["answers"][0]["entity"], asked["answers"][0]["given"]] == [3, "e1", True]
    assert asked["id"] == {"any": ["JSON"]}
    assert asked["sure"] is True
    assert related["answers"][0]["entity"] == "in"
    assert [len(near["nearest"]), sorted(near["nearest"][0])] == [2, ["cosine", "entity"]]
    assert len(all_["interference"]["above"]) == 3
    assert len(one["interference"]["above"]) == 1
    assert undone["updated"] == ["new c"]
    assert set(fact["updated"]) == {"new a", "new b"}
    assert (removed["removed"], removed["updated"]) == (["new b"], ["new a"])
    assert [change["do"] for change in history["history"]] == [
        "insert",
        "insert",
        "observe",
        "undo",
        "remove",
        "remove",
    ]

    live = live_of()  # the same by the object
    live.insert("new a", [("new a", "in", "e1")], kind="place")
    live.insert(["new c"], [("new c", "on", "e3")])
    again = isi.open(home)
    assert_same(seen(again), seen(live))


def test_an_answer_that_is_not_supported_says_so(home: Path) -> None:
    (found,) = answered(home, {"ask": ["e0", "on", None], "top": 1})
    best = found["answers"][0]
    assert found["sure"] is (best["known"] or best["probability"] >= 0.2)
    live = live_of()
    unsure = [name for name in KNOWN.entity_names if not live.ask(name, "in").sure]
    assert unsure
    assert json.loads(answer(live, lines({"ask": [unsure[0], "in", None]})))["sure"] is False


BAD: list[Any] = [
    [], 5, None, "undo", {}, {"id": 1}, {"undo": False}, {"undo": True, "history": True}, {"histor": True},
    {"observe": [["e1", "in"]]}, {"observe": [["e1", "in", "e99"]]}, {"observe": [["e1", "inn", "e2"]]},
    {"observe": "e1 in e2"}, {"observe": [5]}, {"observe": None}, {"observe": [["new a", "in", None]]},
    {"insert": "new a"}, {"insert": "new a", "facts": [["e1", "in", "e2"]]}, {"insert": "e1", "facts": []},
    {"insert": 5}, {"insert": ["x", 5]}, {"insert": {"x": 5}}, {"insert": {"x": {"in": [5]}}}, {"insert": "a\tb"},
    {"insert": "new a", "facts": [["new a", "in", "e1"]], "kind": "robot"},
    {"insert": "new a", "facts": [["new a", "in", "e1"]], "initializer": "none"},
    {"insert": "new a", "facts": [["new a", "in", "e1"]], "initializer": "map", "options": {"strength": -1.0}},
    {"insert": "new a", "facts": [["new a", "in", "e1"]], "seed": -1}, {"remove": "e1"}, {"remove": "new a"},
    {"remove": True, "facts": [["e1", "in", "e2"]]}, {"undo": True}, {"ask": ["e1", "in", "e2"]},
    {"ask": [None, None, "e2"]}, {"ask": ["e1", "in", None], "top": 0}, {"ask": ["e1", "in", None], "tops": 3},
    {"ask": ["e1", "in"]}, {"nearest": "nobody"}, {"nearest": ["e1"]}, {"explain": 5},
]  # fmt: skip


def test_a_bad_request_is_refused_in_one_line_and_changes_nothing(home: Path) -> None:
    live, journal = live_of(), (home / "journal.jsonl").read_bytes()
    for request in BAD:
        refused = json.loads(answer(live, json.dumps(request).encode()))
        assert list(refused)[-1] == "error", request
        assert "\n" not in refused["error"]
        assert live.history == []
    *refusals, last = answered(home, *BAD, {"nearest": "e1"})
    assert all(refusal["error"] for refusal in refusals)
    assert len(refusals) == len(BAD)
    assert last["nearest"]
    assert (home / "journal.jsonl").read_bytes() == journal


@pytest.mark.parametrize(
    "line", [b"", b"\n", b"\xff\xfe\n", b'{"undo": tru\n', b"[" * 9999, b'{"id": NaN}', b"9" * 9999]
)
def test_a_line_that_is_no_json_is_refused(line: bytes) -> None:
    assert list(json.loads(answer(live_of(), line)))[-1] == "error"


def test_the_schema_of_requests_covers_the_verbs() -> None:
    assert {*VERBS} == {
        "insert", "observe", "remove", "undo", "ask", "nearest", "explain", "interference", "history"
    }  # fmt: skip
    assert all(callable(getattr(isi.LiveEmbedding, verb, None)) or verb == "history" for verb in VERBS)


@contextmanager
def serving(folder: Path) -> Iterator[tuple[subprocess.Popen[bytes], Client]]:
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    with subprocess.Popen([*COMMAND, str(folder)], **pipes) as process:  # type: ignore[call-overload]
        assert process.stdin
        assert process.stdout
        yield process, Client(process.stdout, process.stdin)
        process.kill()


def test_clients_of_a_socket_see_one_embedding(home: Path, tmp_path: Path) -> None:
    path = tmp_path / "socket"
    with socket_of(home, path) as process:
        one, other, verbose = connect(path), connect(path), connect(path)
        assert one({"insert": "new a", "facts": [["new a", "in", "e1"]]})["inserted"] == ["new a"]
        assert other({"ask": ["new a", "in", None], "top": 1})["answers"][0]["given"] is True
        other.writer.write(b'{"observe": [["new a", ')  # half a request, and a client that goes away
        other.writer.flush()
        other.writer.close()
        with suppress(ConnectionError):  # it is left, since its request is too long
            verbose.writer.write(b"x" * 2**21)
            assert verbose.reader.readline() == b""
        third = connect(path)
        assert third({"observe": [["new a", "on", "e2"]]})["updated"] == ["new a"]
        assert len(one({"history": True})["history"]) == 2
        process.send_signal(signal.SIGTERM)
        _, errors = process.communicate(timeout=PATIENCE)
    assert (process.returncode, errors) == (0, b"")
    assert not path.exists()
    with socket_of(home, path) as process:  # again, after a socket that a killed process has left
        process.kill()
        process.wait()
        assert path.is_socket()
        with socket_of(home, path):
            assert len(connect(path)({"history": True})["history"]) == 2


def test_a_second_process_is_refused_in_one_line_and_a_signal_ends_the_first(home: Path) -> None:
    with serving(home) as (process, ask):
        assert ask({"insert": "new a", "facts": [["new a", "in", "e1"]]})["inserted"]
        second = subprocess.run([*COMMAND, str(home)], input=b"", capture_output=True, check=False, timeout=PATIENCE)
        assert (second.returncode, second.stderr.count(b"\n")) == (1, 1)
        assert str(home).encode() in second.stderr
        with pytest.raises(isi.InputError):
            isi.open(home, journal=True)
        assert ask({"nearest": "e1"})["nearest"]
        process.send_signal(signal.SIGTERM)
        out, errors = process.communicate(timeout=PATIENCE)
    assert (process.returncode, out) == (0, b"")
    assert errors.count(b"\n") == 1
    assert isi.open(home, journal=True).inserted.keys() == {"new a"}


def test_a_socket_that_cannot_be_made_is_refused_in_one_line(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("mine", encoding="utf-8")
    live = live_of()
    for path in (tmp_path / "file", tmp_path / "none" / "socket", tmp_path / ("x" * 200)):
        with pytest.raises(isi.InputError, match=path.name[:20]):
            asyncio.run(serve(live, iter([]), path))
    assert (tmp_path / "file").read_text(encoding="utf-8") == "mine"


def changes(number: int) -> list[dict[str, Any]]:
    """Requests that each make a change: insertions, facts about them, removals and some ``undo``."""
    rng, made = random.Random(0), list[dict[str, Any]]()
    for place in range(number // 8):
        name = f"thing {place}"
        known = [f"e{rng.randrange(30)}" for _ in range(5)]
        made += [
            {"insert": name, "facts": [[name, "in", known[0]]]}, {"observe": [[name, "on", known[1]]]}, {"undo": True},
            {"observe": [[known[2], "on", name], [name, "on", "e1"]]}, {"insert": {f"{name} b": {"in": known[3]}}},
            {"observe": [[name, "in", f"{name} b"]]}, {"remove": f"{name} b"},
            {"remove": True, "facts": [[known[2], "on", name]]},
        ]  # fmt: skip
    return made


def go_on(folder: Path, requests: Sequence[dict[str, Any]], kills: int, seed: int) -> list[tuple[int, int, int]]:
    """Send changes to processes that are killed at random moments; the next one is sent what the last has not done.

    Returns for each kill the number of requests that were sent, answered and done.
    """
    rng, counts, least = random.Random(seed), list[tuple[int, int, int]](), 0
    for left in range(kills, -1, -1):
        with serving(folder) as (process, ask):
            done = len(ask({"history": True})["history"])
            if counts:
                counts[-1] = (*counts[-1][:2], done - least)
                assert counts[-1][1] <= done - least <= counts[-1][0]  # what was answered is not lost
            if not left:
                assert all("error" not in ask(request) for request in requests[done:])
                return counts
            sent, least = requests[done : done + rng.randint(4, 12)], done
            os.write(ask.writer.fileno(), lines(*sent))
            answered_before = rng.randint(0, len(sent) // 2)
            for _ in range(answered_before):
                ask.reader.readline()
            time.sleep(rng.random() * 0.02)
            process.kill()
            counts.append((len(sent), answered_before + ask.reader.read().count(b"\n"), 0))
    return counts


@pytest.mark.parametrize("kills", [int(os.environ.get("KILLS", "5"))])
def test_a_stream_that_is_killed_and_gone_on_with_equals_one_that_was_not(tmp_path: Path, kills: int) -> None:
    requests = changes(max(32, 8 * kills))
    whole, killed = written(tmp_path / "whole"), written(tmp_path / "killed")
    with isi.open(whole, journal=True) as live:
        assert all(b'"error"' not in answer(live, lines(request)) for request in requests)
    counts = go_on(killed, requests, kills, 1)
    assert any(done < sent for sent, _, done in counts)  # some were killed at work
    assert (whole / "journal.jsonl").read_bytes() == (killed / "journal.jsonl").read_bytes()
    assert_same(seen(isi.open(whole)), seen(isi.open(killed)))


@pytest.mark.parametrize("torn", [b"{", b'{"do": "undo"}', b'{"do": "observe", "facts": [["e1"\x00\xff'])
def test_a_torn_last_line_does_not_count(home: Path, torn: bytes) -> None:
    journal = home / "journal.jsonl"
    with isi.open(home, journal=True) as live:
        live.insert("new a", [("new a", "in", "e1")])
    content = journal.read_bytes()
    journal.write_bytes(content + torn)
    assert len(isi.open(home).history) == 1
    with isi.open(home, journal=True) as live:
        assert len(live.history) == 1
        live.observe([("new a", "on", "e1")])
    assert journal.read_bytes().startswith(content + b'{"do": "observe"')
    journal.write_bytes(content + torn + b"\n")
    if torn != b'{"do": "undo"}':
        with pytest.raises(isi.InputError, match=f"line {len(chosen()) + 2}"):
            isi.open(home)


def test_the_vectors_of_the_journal_are_those_that_the_stream_had(home: Path) -> None:
    live = isi.open(home, journal=True)
    for request in changes(16):
        assert b'"error"' not in answer(live, lines(request))
    live.close()
    for name, row in isi.open(home).inserted.items():
        np.testing.assert_allclose(row.vector, live.inserted[name].vector, rtol=0, atol=1e-6)
