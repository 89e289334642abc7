"""The folder of a home: processes that are killed, full disks, threads, other databases."""

import os
import random
import resource
import signal
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

import isi
from isi.errors import InputError
from isi.home.derived import Derived
from isi.home.home import Home
from tests.small_bundle import files, home_of
from tests.small_home import KNOWN, TRAINED, assert_same, facts_of, seen
from tools.kills.home import NEGATIVE, killed

pytestmark = pytest.mark.usefixtures("quick")
MUG = ("mug", "in", "e1")
FIRST = TRAINED[0]


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return home_of(tmp_path / "home", KNOWN)


@contextmanager
def files_of_at_most(size: int) -> Iterator[None]:
    """A limit on the size of files, as a full disk is one."""
    largest = resource.getrlimit(resource.RLIMIT_FSIZE)
    handler = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, largest[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, largest)
        signal.signal(signal.SIGXFSZ, handler)


@pytest.mark.parametrize(
    ("way", "cause"),
    [("tell", signal.SIGKILL), ("train", signal.SIGKILL), ("create", signal.SIGTERM)],
)
def test_a_killed_process_leaves_all_that_it_acknowledged_and_nothing_half(
    folder: Path, way: str, cause: int
) -> None:
    assert not killed(folder, way, cause, random.Random(way)).lost  # `make kill-test` has others


def test_on_a_full_disk_changes_and_training_are_refused_and_nothing_is_lost(folder: Path) -> None:
    with isi.open(folder) as home, isi.open(folder) as other:
        home.tell([MUG])
        before = seen(home)
        for change in (
            lambda: [home.tell([("mug", "on", f"e{each}")]) for each in range(30)],
            lambda: home.train_again(NEGATIVE),
            lambda: home.save(folder.parent / "copy"),
        ):
            with files_of_at_most(1024), pytest.raises(InputError, match="cannot be"):
                change()
            for each in (home, other):
                assert_same(seen(each), before)
        home.tell([("mug", "on", "e4")])
        after = seen(home)
        assert_same(seen(other), after)
    with isi.open(folder) as again:
        assert_same(seen(again), after)
        assert len(again.history()) == 2


def test_an_interrupted_change_is_there_if_it_was_committed(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupted(*_: Any) -> None:
        raise KeyboardInterrupt

    with isi.open(folder) as home:
        monkeypatch.setattr(home.database, "inserted", interrupted)
        with pytest.raises(KeyboardInterrupt):
            home.tell([MUG])
        monkeypatch.undo()
        assert list(home.inserted) == [name for name in ("mug",) if MUG in facts_of(home)]


@pytest.mark.parametrize("objects", [1, 2])
def test_threads_insert_into_one_home(folder: Path, objects: int) -> None:
    lives = [isi.open(folder) for _ in range(objects)]

    def work(thread: int) -> None:
        for number in range(15):
            name = f"thing {'xy'[thread]} {number}"
            lives[thread % objects].tell({name: {"in": "e1"}}, initializer="mean")
            assert name in lives[0].inserted

    with ThreadPoolExecutor(2) as threads:
        list(threads.map(work, range(2)))
    for home in (*lives, isi.open(folder)):
        assert len(home.inserted) == len(home.history()) == 30


def statements(home: Home, change: Callable[[], object]) -> int:
    """The number of statements that the database runs for a change."""
    run = list[str]()
    home.database.connection.set_trace_callback(run.append)
    change()
    home.database.connection.set_trace_callback(None)
    return len(run)


def test_the_work_of_a_change_and_of_taking_one_over_does_not_grow_with_the_history(
    folder: Path,
) -> None:
    with isi.open(folder) as home, isi.open(folder) as other:
        numbers = []
        for _ in range(3):
            home.tell([FIRST])
            of_tell = statements(home, lambda: home.tell([FIRST]))
            of_others = statements(other, lambda: other.ask("e0", "in"))
            with isi.open(folder) as opened:
                of_opening = statements(opened, lambda: Derived(opened.database, opened.base))
            numbers.append((of_tell, of_others, of_opening))
            for each in range(20):
                home.tell([("e1", "on", f"e{each}")])
        assert numbers[0] == numbers[1] == numbers[2]


def test_a_home_that_cannot_be_written_can_be_asked(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with isi.open(folder) as home:
        home.tell([MUG])
        expected = seen(home)
    before = files(folder)
    with isi.open(folder, durability="memory") as copy:
        assert copy.tell([("cup", "in", "e2")]).inserted == ["cup"]
    monkeypatch.setattr(os, "access", lambda *_: False)
    with isi.open(folder) as home:
        assert_same(seen(home), expected)
        assert home.explain("mug").indicators
        with pytest.raises(InputError, match="may not write"):
            home.tell([MUG])
    assert files(folder) == before


def test_a_folder_with_a_home_of_changes_or_with_other_files_is_not_written_into(
    folder: Path,
) -> None:
    home = isi.open(folder)
    copy = folder.parent / "copy"
    for _ in range(2):  # over a home without changes, too
        home.save(copy)
    home.tell([MUG])
    home.save(copy)
    with pytest.raises(InputError, match="1 changes"):
        home.save(copy)
    (folder.parent / "mine").mkdir()
    (folder.parent / "mine/notes.txt").write_text("mine", encoding="utf-8")
    for taken in (folder, folder.parent / "mine", folder.parent / "mine/notes.txt"):
        with pytest.raises(InputError):
            home.save(taken)
    assert_same(seen(isi.open(copy)), seen(home))
