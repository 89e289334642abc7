"""``isi live``: the protocol, clients of a socket, processes that are killed,
and two processes on one folder.
"""

import asyncio
import json
import os
import random
import signal
import subprocess
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from datetime import UTC, datetime
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from isi.live.folder import Bundle, Manifest, write
from isi.live.journal import text_of

import isi
from isi.initializers.api import INITIALIZERS, InitContext, InitResult, initializer
from isi.live.stream import answer, serve, take_step
from tests.environment import CAN_MOUNT, OWN_MOUNTS, PATIENCE
from tests.live_processes import COMMAND, Client, connect, lines, socket_of
from tests.small_live import KNOWN, assert_same, chosen, live_of, seen

KNOWN_FACTS = KNOWN.named_triples()
#: Facts of known entities that the embedding was not trained on.
UNKNOWN = [
    fact for fact in product(["e0", "e3"], ["in"], KNOWN.entity_names) if fact not in KNOWN_FACTS
]


def written(folder: Path) -> Path:
    """A folder with the bundle of test_live, and a journal with its choices."""
    live_of().save(folder)
    (folder / "journal.jsonl").write_text(text_of(chosen()), encoding="utf-8")
    return folder


def answered(folder: Path, *requests: Any) -> list[dict[str, Any]]:
    """The answers of a process to all requests at once."""
    done = subprocess.run(
        [*COMMAND, str(folder)],
        input=lines(*requests),
        capture_output=True,
        check=True,
        timeout=PATIENCE,
    )
    assert done.stderr == b""
    return [json.loads(line) for line in done.stdout.splitlines()]


@pytest.fixture
def home(tmp_path: Path) -> Path:
    return written(tmp_path / "home")


def test_a_question_in_another_spelling_has_a_note_in_its_answer() -> None:
    live = live_of()

    def result(request: dict[str, Any]) -> dict[str, Any]:
        parsed: dict[str, Any] = json.loads(answer(live, json.dumps(request).encode()))
        return parsed

    result({"insert": "gas hob", "facts": [["gas hob", "in", "e1"]]})
    for request in (
        {"ask": ["Gas-Hob", "in", None]},
        {"nearest": "Gas-Hob"},
        {"explain": "Gas-Hob"},
        {"interference": ["Gas-Hob"]},
    ):
        (note,) = result(request)["notes"]
        assert "'Gas-Hob'" in note
        assert "'gas hob'" in note
    assert "notes" not in result({"ask": ["gas hob", "in", None]})
    assert "'gas hob'" in result({"remove": "Gas-Hob"})["error"]
    assert "'gas hob'" in result({"observe": [["Gas-Hob", "in", "e1"]]})["error"]


def test_each_request_has_an_answer(home: Path) -> None:
    requests: list[dict[str, Any]] = [
        {"insert": "new a", "facts": [["new a", "in", "e1"]], "kind": "place", "id": 1},
        {
            "insert": {"new b": {"in": ["e1", "e2"], "on": "new a"}, "new c": {"on": "e3"}},
            "id": "two",
        },
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
    (inserted, two, observed, asked, related, near, all_, one, undone, fact, removed, history) = (
        answered(home, *requests)
    )
    assert (inserted["id"], inserted["inserted"], inserted["known"]) == (1, ["new a"], 0)
    assert (two["id"], two["inserted"], two["updated"]) == ("two", ["new b", "new c"], ["new a"])
    assert (observed["updated"], observed["known"]) == (["new c"], 1)
    assert asked["query"] == ["new a", "in", "?"]
    assert [len(asked["answers"]), asked["answers"][0]["entity"], asked["answers"][0]["given"]] == [
        3,
        "e1",
        True,
    ]
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


#: Requests that are refused, as a client sends them.
BAD = f"""
{{"undo": true, "kind": "place"}}
{{"nearest": "e1", "source": "camera"}}
{{"ask": ["e1", "in", null], "upsert": true}}
[]
5
null
"undo"
{{}}
{{"id": 1}}
{{"undo": false}}
{{"undo": true}}
{{"undo": true, "history": true}}
{{"undo": true, "source": "a\\tb"}}
{{"histor": true}}
{{"observe": null}}
{{"observe": [5]}}
{{"observe": "e1 in e2"}}
{{"observe": [["e1", "in"]]}}
{{"observe": [["e1", "in", "e99"]]}}
{{"observe": [["e1", "inn", "e2"]]}}
{{"observe": [["new a", "in", null]]}}
{{"observe": [], "facts": {json.dumps(UNKNOWN[:1])}}}
{{"observe": {json.dumps(UNKNOWN[:1])}, "source": "two\\nlines"}}
{{"move": {json.dumps(UNKNOWN[0])}, "facts": {json.dumps(UNKNOWN[1:2])}}}
{{"insert": 5}}
{{"insert": "a\\tb"}}
{{"insert": "new a"}}
{{"insert": "e1", "facts": []}}
{{"insert": ["x", 5]}}
{{"insert": {{"x": 5}}}}
{{"insert": {{"x": {{"in": [5]}}}}}}
{{"insert": "new a", "facts": [["e1", "in", "e2"]]}}
{{"insert": "new a", "facts": [["new a", "in", "new b"]]}}
{{"insert": ["new a"], "facts": [["new a", "in", "e1"], ["new a", "in"]]}}
{{"insert": ["new a", "New_A"], "facts": [["new a", "in", "e1"], ["New_A", "in", "e1"]]}}
{{"insert": "new a", "facts": [["new a", "in", "e1"]], "kind": "robot"}}
{{"insert": "new a", "facts": [["new a", "in", "e1"]], "kind": {{"new": "object"}}}}
{{"insert": "new a", "facts": [["new a", "in", "e1"]], "definition": {{"new": "a thing"}}}}
{{"insert": "new a", "facts": [["new a", "in", "e1"]], "initializer": "none"}}
{{"insert": "new a", "facts": [["new a", "in", "e1"]], "initializer": "rs", "options": {{"k": 0}}}}
{{"insert": "new a", "facts": [["new a", "in", "e1"]], "seed": -1}}
{{"remove": "e1"}}
{{"remove": "new a"}}
{{"remove": true, "facts": [["e1", "in", "e2"]]}}
{{"ask": ["e1", "in"]}}
{{"ask": ["e1", "in", "e2"]}}
{{"ask": [null, null, "e2"]}}
{{"ask": ["e1", "in", null], "top": 0}}
{{"ask": ["e1", "in", null], "tops": 3}}
{{"nearest": "nobody"}}
{{"nearest": ["e1"]}}
{{"explain": 5}}
{{"explain": "e1"}}
""".strip().splitlines()


def test_a_bad_request_is_refused_in_one_line_and_changes_nothing(home: Path) -> None:
    live, journal = live_of(), (home / "journal.jsonl").read_bytes()
    for request in BAD:
        refused = json.loads(answer(live, request.encode()))
        assert list(refused)[-1] == "error", request
        assert "\n" not in refused["error"]
        assert live.history == []
    *refusals, last = answered(home, *map(json.loads, BAD), {"nearest": "e1"})
    assert all(refusal["error"] for refusal in refusals)
    assert len(refusals) == len(BAD)
    assert last["nearest"]
    assert (home / "journal.jsonl").read_bytes() == journal


@pytest.mark.parametrize(
    "line", [b"", b"\n", b"\xff\xfe\n", b'{"undo": tru\n', b"[" * 9999, b'{"id": NaN}', b"9" * 9999]
)
def test_a_line_that_is_no_json_is_refused(line: bytes) -> None:
    assert list(json.loads(answer(live_of(), line)))[-1] == "error"


@pytest.mark.parametrize(
    "label", [r'"\ud800"', r'{"\udfff": 1}', "1e999", "[-1e999]", "[" * 300 + "]" * 300]
)
def test_an_id_that_no_answer_can_repeat_is_refused_and_changes_nothing(label: str) -> None:
    live = live_of()
    head, relation, tail = UNKNOWN[0]
    request = f'{{"observe": [["{head}", "{relation}", "{tail}"]], "id": {label}}}'
    refused = json.loads(answer(live, request.encode()))
    assert list(refused) == ["error"]
    assert refused["error"].startswith("request: id: ")
    assert live.history == []


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
        # half a request, and a client that goes away
        other.writer.write(b'{"observe": [["new a", ')
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
        second = subprocess.run(
            [*COMMAND, str(home)], input=b"", capture_output=True, check=False, timeout=PATIENCE
        )
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


def thor_sized(folder: Path) -> Path:
    """A bundle for which preparation takes many seconds."""
    rng = np.random.default_rng(0)
    entities = rng.standard_normal((145, 100), np.float32) * 0.3
    relations = rng.standard_normal((3, 100), np.float32) * 0.3
    limits = [145, 3, 145]
    triples = np.unique(np.stack([rng.integers(0, most, 1_000) for most in limits], 1), axis=0)
    names = [f"e{number}" for number in range(145)]
    manifest = Manifest(model_name="analogy", model_options={}, words=None, made={}, inserted=[])
    bundle = Bundle(
        manifest, entities, relations, names, [""] * 145, names, ["in", "on", "of"], triples
    )
    write(folder, bundle)
    return folder


@pytest.mark.parametrize(("number", "by_socket"), [(signal.SIGTERM, True), (signal.SIGINT, False)])
def test_a_signal_ends_the_process_while_it_prepares(
    tmp_path: Path, number: signal.Signals, by_socket: bool
) -> None:
    folder, path = thor_sized(tmp_path / "home"), tmp_path / "socket"
    if by_socket:
        with socket_of(folder, path) as process:
            assert connect(path)({"nearest": "e1"})["nearest"]
            process.send_signal(number)
            process.communicate(timeout=PATIENCE)
        assert not path.exists()
    else:
        with serving(folder) as (process, ask):
            assert ask({"nearest": "e1"})["nearest"]
            process.send_signal(number)
            process.communicate(timeout=PATIENCE)
    assert process.returncode == 0


def test_a_socket_of_another_process_is_refused_and_only_the_own_one_is_removed(
    tmp_path: Path,
) -> None:
    one, other = written(tmp_path / "one"), written(tmp_path / "other")
    path = tmp_path / "socket"
    with socket_of(one, path) as process:
        ask = connect(path)
        second = subprocess.run(
            [*COMMAND, str(other), "--socket", str(path)],
            capture_output=True,
            check=False,
            timeout=60,
        )
        assert second.returncode == 1
        assert second.stderr.count(b"\n") == 1
        assert str(path).encode() in second.stderr
        assert ask({"nearest": "e1"})["nearest"]
        assert connect(path)({"nearest": "e1"})["nearest"]
        assert path.stat().st_mode & 0o077 == 0
        path.unlink()
        with socket_of(other, path):  # its own, under the name that the first one had
            process.send_signal(signal.SIGTERM)
            process.communicate(timeout=10)
            assert connect(path)({"nearest": "e1"})["nearest"]


def uniform(number: int, rooms: int) -> pd.DataFrame:
    """Things that all have the same facts: hiding a tenth of them may hide no triple of another."""
    rows = [(f"thing {thing}", "hasAffordance", "open") for thing in range(number)]
    for room in range(rooms):
        rows += [(f"thing {thing}", "atLocation", f"room {room}") for thing in range(number)]
    return pd.DataFrame(rows, columns=["head", "relation", "tail"])


@pytest.mark.parametrize(("number", "rooms"), [(20, 1), (6, 1), (2, 1)])
def test_a_small_uniform_graph_is_served(number: int, rooms: int) -> None:
    live = isi.train(uniform(number, rooms), dimension=12, budget=1)
    live.prepare()
    facts = [["bowl", "atLocation", "room 0"], ["bowl", "hasAffordance", "open"]]
    inserted = json.loads(answer(live, lines({"insert": "bowl", "facts": facts})))
    assert inserted["inserted"] == ["bowl"]
    asked = json.loads(answer(live, lines({"ask": ["bowl", "atLocation", None], "top": 1})))
    assert asked["answers"][0]["entity"] == "room 0"


@pytest.fixture
def failing(monkeypatch: pytest.MonkeyPatch) -> str:
    """A user's own initializer, which has a fault."""
    registered = {name: INITIALIZERS.get(name) for name in INITIALIZERS.names()}
    monkeypatch.setattr(INITIALIZERS, "_registered", registered)

    @initializer("failing")
    def fail(context: InitContext) -> InitResult:
        raise ZeroDivisionError(f"of {len(context.novel)}\nin two lines")

    return "failing"


def test_an_unexpected_error_is_answered_and_logged_and_changes_nothing(
    failing: str, capsys: pytest.CaptureFixture[str]
) -> None:
    live = live_of()
    live.insert("new a", [("new a", "in", "e1")])
    before = seen(live)
    facts = [["new b", "in", "e1"], ["new b", "on", "e2"]]
    request = {"insert": "new b", "facts": facts, "initializer": failing, "id": 7}
    refused = json.loads(answer(live, lines(request)))
    assert refused["id"] == 7
    assert refused["error"].startswith("internal: ZeroDivisionError")
    assert "Traceback" in capsys.readouterr().err
    assert len(live.history) == 1
    assert_same(seen(live), before)
    assert json.loads(answer(live, lines({"observe": [["new a", "on", "e3"]]})))["updated"] == [
        "new a"
    ]


@pytest.mark.parametrize(
    "line",
    [
        b'{"undo": true, "undo": true}',
        b'{"insert": {"a": {"in": "e1"}, "a": {"in": "e2"}}}',
        b'{"ask": ["e1", "in", null], "top": 3, "top": 5}',
    ],
)
def test_a_key_that_stands_twice_is_refused(line: bytes) -> None:
    assert "twice" in json.loads(answer(live_of(), line))["error"]


def test_a_request_that_is_too_long_is_answered_before_the_client_is_left(
    home: Path, tmp_path: Path
) -> None:
    path = tmp_path / "socket"
    with socket_of(home, path):
        for size in (2**20 + 5, 2**22):
            verbose = connect(path)
            with suppress(ConnectionError):
                verbose.writer.write(b"x" * size + b"\n")
                verbose.writer.flush()
            with suppress(ConnectionError):
                assert b"error" in verbose.reader.readline()
        assert connect(path)({"nearest": "e1"})["nearest"]


def test_many_questions_in_one_request(home: Path) -> None:
    live = isi.open(home)
    queries = [["e1", "in", None], [None, "on", "e2"], ["e1", None, "e3"]]
    many = json.loads(answer(live, lines({"ask": queries, "top": 2})))["results"]
    single = [json.loads(answer(live, lines({"ask": query, "top": 2}))) for query in queries]
    assert many == single
    refused = json.loads(answer(live, lines({"ask": [*queries, ["e1", "in"]]})))
    assert "error" in refused


def test_a_change_has_a_time_and_a_source(home: Path) -> None:
    live = isi.open(home, journal=True)
    fact, other = UNKNOWN[:2]
    for moment in ("2026-01-01T12:00:00+02:00", "2026-01-01T10:00:00", 1767261600):
        request = {"observe": [fact], "time": moment, "source": "camera 1"}
        assert json.loads(answer(live, lines(request)))["facts"] == 1
        live.undo()
    live.observe([other])
    live.close()
    changes = isi.open(home).history
    given = [change.time for change in changes if change.source == "camera 1"]
    assert given == [datetime(2026, 1, 1, 10, tzinfo=UTC)] * 3
    assert changes[-1].time
    assert abs((changes[-1].time - datetime.now(UTC)).total_seconds()) < 600
    for moment in ("noon", True, "0001-01-01T00:00:00+05:00", 1e300, -1e15):
        refused = json.loads(answer(live, lines({"observe": [fact], "time": moment})))
        assert refused["error"].startswith("request: time: "), moment


JOURNALS = [
    ('{"do": "observe", "facts": [["sink basin", "in", "e1"]]}', "sink basin"),
    ('{"do": "observe", "facts": [["e1", "beside", "e2"]]}', "beside"),
    ('{"do": "insert", "entities": {"e1": {}}}', "e1"),
    ('{"do": "remove", "entities": {"e1": {}}}', "e1"),
    (json.dumps({"do": "remove", "facts": UNKNOWN[:1]}), " ".join(UNKNOWN[0])),
    (json.dumps({"do": "move", "replaced": UNKNOWN[:1]}), " ".join(UNKNOWN[0])),
    ('{"do": "undo"}', "undo"),
]


@pytest.mark.parametrize(("line", "named"), JOURNALS)
def test_a_journal_of_another_folder_is_refused_in_one_line(
    home: Path, line: str, named: str
) -> None:
    journal = home / "journal.jsonl"
    journal.write_text(text_of(chosen()) + line + "\n", encoding="utf-8")
    place = f"journal.jsonl: line {len(chosen()) + 1}: .*{named}"
    for _ in range(2):  # the refusal lets the folder go
        with pytest.raises(isi.InputError, match=place):
            isi.open(home, journal=True)
    with pytest.raises(isi.InputError, match=place):
        isi.open(home)


def test_vectors_that_were_stored_are_used_only_where_their_inputs_are_the_same(home: Path) -> None:
    with isi.open(home, journal=True) as live:
        live.insert("new a", [("new a", "in", "e1")])
        live.insert(["new b", "new c"], [("new b", "on", "e2"), ("new b", "in", "new c")])
        expected = seen(live)
    stored = home / "inserted.safetensors"
    opened = isi.open(home)
    assert len(opened.groups.stored) == 3
    for name, row in opened.inserted.items():
        assert row.vector.tobytes() == expected[0][name].tobytes()
    content = stored.read_bytes()
    for broken in (b"", content[:-4] + b"\0\0\0\0", b"{}" + content):
        stored.write_bytes(broken)
        assert_same(seen(isi.open(home)), expected)
    stored.write_bytes(content)
    with isi.open(home, journal=True) as live:
        live.observe([("new a", "on", "e4")])
    stored.write_bytes(content)  # of before that change
    fresh = live_of()
    fresh.insert("new a", [("new a", "in", "e1"), ("new a", "on", "e4")])
    fresh.insert(["new b", "new c"], [("new b", "on", "e2"), ("new b", "in", "new c")])
    assert_same(seen(isi.open(home)), seen(fresh))


@pytest.mark.skipif(not CAN_MOUNT, reason="no file system can be mounted here")
def test_a_read_only_folder_is_asked_and_refuses_changes(home: Path) -> None:
    with isi.open(home, journal=True) as live:
        live.insert("new a", [("new a", "in", "e1")])
    (home / "journal.jsonl").open("ab").write(b'{"torn')
    requests = lines({"ask": ["new a", "in", None], "top": 1}, {"undo": True}, {"nearest": "new a"})
    script = (
        f"mount --bind {home} {home} && mount -o remount,bind,ro {home} && "
        f"exec {' '.join(COMMAND)} {home}"
    )
    done = subprocess.run(
        [*OWN_MOUNTS, "sh", "-c", script], input=requests, capture_output=True, check=True
    )
    assert done.stderr == b""
    asked, refused, near = map(json.loads, done.stdout.splitlines())
    assert asked["answers"][0]["entity"] == "e1"
    assert "Read-only file system" in refused["error"]
    assert near["nearest"]


def test_a_lock_is_let_go_where_opening_fails(home: Path) -> None:
    journal = home / "journal.jsonl"
    content = journal.read_bytes()
    journal.unlink()
    journal.mkdir()
    for _ in range(2):
        with pytest.raises(isi.InputError, match="journal"):
            isi.open(home, journal=True)
    journal.rmdir()
    journal.write_bytes(content)
    isi.open(home, journal=True).close()


def test_a_socket_that_cannot_be_made_is_refused_in_one_line(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("mine", encoding="utf-8")
    live = live_of()
    for path in (tmp_path / "file", tmp_path / "none" / "socket", tmp_path / ("x" * 200)):
        with pytest.raises(isi.InputError, match=path.name[:20]):
            asyncio.run(serve(live, iter([]), path))
    assert (tmp_path / "file").read_text(encoding="utf-8") == "mine"


def changes(number: int) -> list[dict[str, Any]]:
    """Requests that each make a change: of each kind, about new and known entities,
    some with ``undo``.
    """
    rng, made = random.Random(0), list[dict[str, Any]]()
    trained = rng.sample(KNOWN.named_triples(), len(KNOWN.triples))
    for place in range(-(-number // 12)):
        name, known = f"thing {place}", [f"e{rng.randrange(30)}" for _ in range(5)]
        head, label, tail = trained[2 * place % len(trained)]
        again = trained[(2 * place + 1) % len(trained)]
        made += [
            {"insert": name, "facts": [[name, "in", known[0]]]},
            {"observe": [[name, "on", known[1]]]},
            {"undo": True},
            {"observe": [[known[2], "on", name], [name, "on", "e1"]]},
            {"insert": {f"{name} b": {"in": known[3]}}},
            {"observe": [[name, "in", f"{name} b"]]},
            {"remove": f"{name} b"},
            {"remove": True, "facts": [[known[2], "on", name]]},
            {"observe": [[f"{name} c", "in", known[4]]], "upsert": True},
            {"move": [name, "in", f"{name} c"], "source": "camera"},
            {"remove": True, "facts": [[head, label, tail], list(again)]},
            {"observe": [list(again)]},
        ]
    for second, request in enumerate(made):
        request["time"] = f"2026-01-01T00:{second // 60 % 60:02}:{second % 60:02}Z"
    return made[:number]


def go_on(
    folder: Path, requests: Sequence[dict[str, Any]], kills: int, seed: int
) -> list[tuple[int, int, int]]:
    """Send changes to processes that are killed at random moments;
    the next one is sent what the last has not done.

    Returns for each kill the number of requests that were sent, answered and done.
    """
    rng, counts, least = random.Random(seed), list[tuple[int, int, int]](), 0
    for left in range(kills, -1, -1):
        with serving(folder) as (process, ask):
            done = len(ask({"history": True})["history"])
            if counts:
                counts[-1] = (*counts[-1][:2], done - least)
                # what was answered is not lost
                assert counts[-1][1] <= done - least <= counts[-1][0]
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


@pytest.mark.parametrize("kills", [int(os.environ.get("KILLS", "3"))])
def test_a_stream_that_is_killed_and_gone_on_with_equals_one_that_was_not(
    tmp_path: Path, kills: int
) -> None:
    requests = changes(max(36, 8 * kills))
    whole, killed = written(tmp_path / "whole"), written(tmp_path / "killed")
    with isi.open(whole, journal=True) as live:
        assert all(b'"error"' not in answer(live, lines(request)) for request in requests)
    counts = go_on(killed, requests, kills, 1)
    assert any(done < sent for sent, _, done in counts)  # some were killed at work
    assert (whole / "journal.jsonl").read_bytes() == (killed / "journal.jsonl").read_bytes()
    assert_same(seen(isi.open(whole)), seen(isi.open(killed)))


@pytest.mark.parametrize(
    "torn", [b"{", b'{"do": "undo"}', b'{"do": "observe", "facts": [["e1"\x00\xff']
)
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


def test_an_answer_that_is_not_supported_says_so(home: Path) -> None:
    (found,) = answered(home, {"ask": ["e0", "on", None], "top": 1})
    best = found["answers"][0]
    assert found["sure"] is (best["known"] or best["probability"] >= 0.2)
    live = live_of()
    unsure = [name for name in KNOWN.entity_names if not live.ask(name, "in").sure]
    assert unsure
    assert json.loads(answer(live, lines({"ask": [unsure[0], "in", None]})))["sure"] is False


def test_a_step_of_the_preparation_that_fails_is_logged_and_the_next_one_is_taken(
    capsys: pytest.CaptureFixture[str],
) -> None:
    taken = list[int]()

    def fail() -> None:
        raise IndexError("no such row")

    steps = iter([fail, lambda: taken.append(1)])
    assert take_step(steps)
    assert "IndexError" in capsys.readouterr().err
    assert take_step(steps)
    assert taken == [1]
    assert not take_step(steps)


def test_the_vectors_of_the_journal_are_those_that_the_stream_had(home: Path) -> None:
    live = isi.open(home, journal=True)
    for request in changes(16):
        assert b'"error"' not in answer(live, lines(request))
    live.close()
    for name, row in isi.open(home).inserted.items():
        np.testing.assert_allclose(row.vector, live.inserted[name].vector, rtol=0, atol=1e-6)
