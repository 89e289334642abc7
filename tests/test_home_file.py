"""The file of a home is what several processes make of it: a state machine with an independent
model; then files that are replaced, moved, broken, locked, or of another program.
"""

import os
import shutil
import sqlite3
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from dataclasses import dataclass, replace
from datetime import datetime, timedelta, tzinfo
from functools import partial
from pathlib import Path
from time import monotonic
from typing import Any

import pytest
from hypothesis import HealthCheck, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, rule, run_state_machine_as_test

import isi
from isi.errors import InputError
from isi.home import times
from isi.home.bundle import Fact
from isi.home.database import Database
from isi.home.folder import _write, create
from isi.home.home import Home
from isi.home.undo import forget
from tests.home_beside import Beside, Known, known, open_quickly, read_alone
from tests.small_bundle import home_of
from tests.small_home import KNOWN, TRAINED, quick_choices

FACTS = [*TRAINED[:4], ("e1", "on", "e20"), ("e2", "in", "e21"), ("e2", "in", "e22")]
NEW = ("mug", "jar")  #: Names that are not trained.
FACTS += [("mug", "in", "e1"), ("mug", "on", "e2"), ("jar", "in", "mug")]
WHO = st.sampled_from([0, 1, 2])
SOURCES = st.sampled_from([None, "camera", "Ann"])


@dataclass(frozen=True)
class Made:
    """A change that was made, as what it did to facts and entities, in order."""

    id: int
    time: str
    source: str | None
    works: Sequence[tuple[str, Any]]
    undone: bool = False
    forgotten: bool = False

    @property
    def can_be_undone(self) -> bool:
        return not (self.undone or self.forgotten)

    @property
    def touched(self) -> set[str]:
        """The names in all that it did."""
        return {
            name
            for work, subject in self.works
            for name in ([subject] if work in ("insert", "remove") else subject[:3:2])
        }


def known_after(changes: Sequence[Made]) -> tuple[dict[Fact, Known], list[str]]:
    """What a home knows after those changes that were not undone."""
    holds: dict[Fact, Known] = dict.fromkeys(TRAINED, (1, None, None, None, None))
    retracted, inserted = dict[Fact, Known](), set[str]()
    for change in changes:
        for work, subject in () if change.undone else change.works:
            if work == "insert":
                inserted.add(subject)
            elif work == "remove":
                inserted.remove(subject)
            elif work == "take":
                row = holds.pop(subject)
                if subject in TRAINED:
                    retracted[subject] = row
            else:
                *parts, confidence = subject
                fact = tuple(parts)
                row = holds.get(fact) or retracted.pop(fact, (0, None, None, None, None))
                count, believed, first, last, source = row
                holds[fact] = (
                    count + 1,
                    believed if confidence is None else confidence,
                    min(first or change.time, change.time),
                    max(last or change.time, change.time),
                    change.source or source,
                )
    return holds, sorted(inserted)


class Clock(datetime):
    """The clock of this process, which may be wrong."""

    wrong_by = timedelta(0)

    @classmethod
    def now(cls, tz: tzinfo | None = None) -> datetime:  # type: ignore[override]
        return datetime.now(tz) + cls.wrong_by


class OneFile(RuleBasedStateMachine):
    """Two objects of this process, one of another, and a reader without rights have a home open."""

    template: Path

    def __init__(self) -> None:
        super().__init__()
        self.base = self.template.with_name("run")
        shutil.rmtree(self.base, ignore_errors=True)
        self.folder = self.base / "home"
        shutil.copytree(self.template, self.folder)
        self.changes: list[Made] = []
        self.backups: list[tuple[Path, list[Made]]] = []
        Clock.wrong_by = timedelta(0)
        self.open()

    def open(self) -> None:
        self.beside, self.reader = Beside(self.folder), Beside(self.folder, may_write=False)
        self.homes = [open_quickly(self.folder), open_quickly(self.folder)]

    def close(self) -> None:
        for home in self.homes:
            home.close()
        self.beside.end()
        self.reader.end()

    @invariant()
    def all_know_what_the_changes_say(self) -> None:
        expected = known_after(self.changes)
        assert self.reader("known") == expected
        assert self.beside("known") == expected
        for home in self.homes:
            assert known(home) == expected

    def teardown(self) -> None:
        try:
            self.undo_everything()
        finally:
            self.close()

    def undo_everything(self) -> None:
        home = self.homes[0]
        assert not home.database.faults()
        while any(change.can_be_undone for change in self.changes):
            home.undo()
            self.mark_undone(-1)
        with pytest.raises(InputError):
            home.undo()
        self.all_know_what_the_changes_say()

    def mark_undone(self, place: int) -> None:
        """Mark the change at a place among those that can be undone."""
        number = [change.id for change in self.changes if change.can_be_undone][place]
        self.changes = [
            replace(change, undone=True) if change.id == number else change
            for change in self.changes
        ]

    # -- changes -----------------------------------------------------------------------------------

    def do(self, who: int, verb: str, *args: Any, **kwargs: Any) -> Any:
        if who == 2:
            return self.beside(verb, *args, **kwargs)
        return getattr(self.homes[who], verb)(*args, **kwargs)

    def made(self, works: Sequence[tuple[str, Any]], given: str | None, source: str | None) -> None:
        """Note a change; its time is the given one, or not before that of the last change."""
        *_, before, (number, time) = self.homes[0].database.rows("SELECT id, time FROM change")
        assert time == given if given else time >= before[1]
        self.changes.append(Made(number, time, source, works))

    @rule(
        who=WHO,
        facts=st.lists(st.sampled_from(FACTS), min_size=1, max_size=3, unique=True),
        confidence=st.sampled_from([None, None, 0.5, 0.9]),
        day=st.sampled_from([None, None, None, 2, 9]),
        source=SOURCES,
    )
    def tell(
        self,
        who: int,
        facts: list[Fact],
        confidence: float | None,
        day: int | None,
        source: str | None,
    ) -> None:
        time = None if day is None else f"2026-12-{day:02}T12:00:00Z"
        _, inserted = known_after(self.changes)
        names = dict.fromkeys(end for head, _, tail in facts for end in (head, tail))
        works = [("insert", name) for name in names if name in NEW and name not in inserted]
        works += [("tell", (*fact, confidence)) for fact in facts]
        given = {"confidence": confidence, "time": time, "source": source, "initializer": "mean"}
        self.do(who, "tell", facts, **given)
        self.made(works, time, source)

    @rule(who=WHO, fact=st.sampled_from(FACTS[:7]), source=SOURCES)
    def move(self, who: int, fact: Fact, source: str | None) -> None:
        holds, _ = known_after(self.changes)
        works = [("take", row) for row in holds if row[:2] == fact[:2] and row != fact]
        self.do(who, "move", *fact, source=source)
        self.made([*works, ("tell", (*fact, None))], None, source)

    @rule(who=WHO, fact=st.sampled_from(FACTS))
    def remove_fact(self, who: int, fact: Fact) -> None:
        if fact not in known_after(self.changes)[0]:
            with pytest.raises(InputError):
                self.do(who, "remove", facts=[fact])
            return
        self.do(who, "remove", facts=[fact])
        self.made([("take", fact)], None, None)

    @rule(who=WHO, name=st.sampled_from(NEW), source=SOURCES)
    def remove_entity(self, who: int, name: str, source: str | None) -> None:
        holds, inserted = known_after(self.changes)
        if name not in inserted:
            with pytest.raises(InputError):
                self.do(who, "remove", name)
            return
        self.do(who, "remove", name, source=source)
        works = [("take", fact) for fact in holds if name in fact]
        self.made([*works, ("remove", name)], None, source)

    # -- changes are taken back and forgotten ------------------------------------------------------

    @rule(who=WHO)
    def undo(self, who: int) -> None:
        if not any(change.can_be_undone for change in self.changes):
            with pytest.raises(InputError):
                self.do(who, "undo")
            return
        self.do(who, "undo")
        self.mark_undone(-1)

    @rule(who=WHO, place=st.integers(0, 9))
    def undo_an_older_one(self, who: int, place: int) -> None:
        changes = [change for change in self.changes if change.can_be_undone]
        if not changes:
            return
        place %= len(changes)
        target, later = changes[place], changes[place + 1 :]
        others = [change.id for change in later if change.touched & target.touched]
        before = known_after(self.changes)
        try:
            self.do(who, "undo", change=target.id)
            self.mark_undone(place)
        except InputError as error:
            refused = str(error)
            if not any(f"undo {number} first" in refused for number in others):
                raise
            assert known(self.homes[0]) == before

    @rule(who=WHO, source=st.sampled_from(["camera", "Ann"]))
    def undo_of_a_source(self, who: int, source: str) -> None:
        changes = [change for change in self.changes if change.can_be_undone]
        places = [place for place, change in enumerate(changes) if change.source == source]
        try:
            self.do(who, "undo", source=source)
        except InputError:
            assert not places or places[-1] < len(changes) - 1
            return
        self.mark_undone(places[-1])

    @rule(place=st.integers(0, 9))
    def forget_older_ones(self, place: int) -> None:
        if not self.changes:
            return
        time = self.changes[place % len(self.changes)].time
        listed = self.homes[0].database.rows("SELECT id, time FROM change")
        first = min(number for number, each in listed if each >= time)
        forget(self.homes[0].database, time)
        self.changes = [replace(each, forgotten=each.id < first) for each in self.changes]

    # -- processes, files and clocks ---------------------------------------------------------------

    @rule(hours=st.sampled_from([-50, 0, 1, 700]))
    def set_the_clock(self, hours: int) -> None:
        Clock.wrong_by = timedelta(hours=hours)

    @rule()
    def kill_the_other_process(self) -> None:
        self.beside.end()
        self.beside = Beside(self.folder)

    @rule()
    def open_again(self) -> None:
        self.close()
        self.open()

    @rule(verb=st.sampled_from(["tell", "ask"]))
    def use_it_in_a_fork(self, verb: str) -> None:
        process = os.fork()
        if not process:
            try:
                getattr(self.homes[0], verb)(*([[FACTS[0]]] if verb == "tell" else FACTS[0][:2]))
            except InputError:
                os._exit(0)
            finally:
                os._exit(1)
        assert os.waitpid(process, 0)[1] == 0

    @rule()
    def ask_while_another_program_writes(self) -> None:
        with closing(sqlite3.connect(self.folder / "home.sqlite", isolation_level=None)) as tool:
            tool.execute("BEGIN IMMEDIATE")
            self.all_know_what_the_changes_say()

    @rule()
    def save(self) -> None:
        folder = self.base / f"copy {len(self.backups)}"
        self.homes[0].save(folder)
        self.backups.append((folder, list(self.changes)))

    @rule(move=st.booleans())
    def put_a_copy_back(self, move: bool) -> None:
        if not self.backups:
            return
        folder, changes = self.backups[-1]
        if move:
            self.folder.rename(self.base / f"moved {os.urandom(4).hex()}")
        else:
            shutil.rmtree(self.folder)
        for who in range(3):
            with pytest.raises(InputError, match=r"home\.sqlite"):
                self.do(who, "tell", [FACTS[0]])
        shutil.copytree(folder, self.folder)
        for who in range(3):
            for verb, *args in (("ask", *FACTS[0][:2]), ("tell", [FACTS[0]]), ("undo",)):
                with pytest.raises(InputError, match="open it again"):
                    self.do(who, verb, *args)
        self.changes = list(changes)
        assert self.reader("known") == known_after(changes)
        self.open_again()


@pytest.mark.usefixtures("quick")
def test_what_several_processes_say_to_one_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(times, "datetime", Clock)
    monkeypatch.setattr(OneFile, "template", home_of(tmp_path / "template", KNOWN), raising=False)
    with quick_choices(of_known=True):
        run_state_machine_as_test(
            OneFile,
            settings=settings(
                max_examples=int(os.environ.get("EXAMPLES", "12")),
                stateful_step_count=25,
                suppress_health_check=list(HealthCheck),
            ),
        )


# Files


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return home_of(tmp_path / "home", KNOWN)


def edit(folder: Path, *statements: str) -> None:
    """Change the database by another program, which checks no foreign keys."""
    with closing(sqlite3.connect(folder / "home.sqlite")) as tool:
        for statement in statements:
            tool.execute(statement)
        tool.commit()


def overwrite(folder: Path, copy: Path) -> None:
    shutil.copyfile(copy / "home.sqlite", folder / "home.sqlite")


def overwrite_all(folder: Path, copy: Path) -> None:
    overwrite(folder, copy)
    remove_log(folder, copy)


def replace_file(folder: Path, copy: Path) -> None:
    shutil.copyfile(copy / "home.sqlite", folder / "new")
    (folder / "new").replace(folder / "home.sqlite")


def move_folder(folder: Path, _: Path) -> None:
    folder.rename(folder.with_name("moved"))


def remove_log(folder: Path, _: Path) -> None:
    for ending in ("-wal", "-shm"):
        (folder / f"home.sqlite{ending}").unlink()


@pytest.mark.usefixtures("quick")
@pytest.mark.parametrize(
    "disturb", [overwrite, overwrite_all, replace_file, move_folder, remove_log]
)
def test_nothing_is_told_to_a_file_that_is_not_the_one_that_was_opened(
    folder: Path, disturb: Any
) -> None:
    copy = shutil.copytree(folder, folder.with_name("copy"))
    with isi.open(folder) as home:
        home.tell([FACTS[4]])
        home.database.rows("PRAGMA wal_checkpoint(TRUNCATE)")
        disturb(folder, copy)
        for refused in (partial(home.tell, [FACTS[5]]), partial(home.ask, *FACTS[0][:2])):
            with pytest.raises(InputError, match="open it"):
                refused()
    if disturb is remove_log:
        assert known(isi.open(folder))[0].keys() == {*TRAINED, FACTS[4]}
    elif disturb is not move_folder:
        assert known(isi.open(folder))[0].keys() == {*TRAINED}


@pytest.mark.usefixtures("quick")
def test_a_change_during_which_the_file_is_replaced_is_refused(folder: Path) -> None:
    copy = shutil.copytree(folder, folder.with_name("copy"))
    home = isi.open(folder)
    with pytest.raises(InputError, match="open it"), home.database.transaction():
        replace_file(folder, copy)
    home.close()
    assert known(isi.open(folder))[0].keys() == {*TRAINED}


@pytest.mark.usefixtures("quick")
def test_a_database_that_is_restored_by_sqlite_is_read_anew(folder: Path) -> None:
    copy = shutil.copytree(folder, folder.with_name("copy"))
    with isi.open(folder) as home:
        home.tell([FACTS[7], FACTS[4]])
        files = copy / "home.sqlite", folder / "home.sqlite"
        with closing(sqlite3.connect(files[0])) as old, closing(sqlite3.connect(files[1])) as new:
            old.backup(new)
        assert known(home) == known_after([])
        assert home.tell([FACTS[7]]).inserted == ["mug"]


@pytest.mark.usefixtures("quick")
def test_a_log_that_a_crash_has_left_is_read_where_no_file_can_be_written(folder: Path) -> None:
    beside = Beside(folder)
    beside("tell", [FACTS[4]])
    beside.end()
    (folder / "home.sqlite-shm").unlink()
    before = sorted(folder.iterdir())
    with read_alone(folder) as home:
        assert FACTS[4] in known(home)[0]
        with pytest.raises(InputError, match="may not write"):
            home.tell([FACTS[5]])
    assert sorted(folder.iterdir()) == before


@pytest.mark.usefixtures("quick")
def test_a_question_does_not_wait_while_a_change_waits_for_another_program(folder: Path) -> None:
    with isi.open(folder) as home, ThreadPoolExecutor(1) as thread:
        home.ask(*FACTS[0][:2])
        with closing(sqlite3.connect(folder / "home.sqlite", isolation_level=None)) as tool:
            tool.execute("BEGIN IMMEDIATE")
            change = thread.submit(home.tell, [FACTS[4]])
            begin = monotonic()
            while monotonic() < begin + 0.5:
                asked = monotonic()
                home.ask(*FACTS[0][:2])
                assert monotonic() < asked + 10  # the change waits for up to a minute
            assert not change.done()
            tool.execute("ROLLBACK")
        assert change.result().facts == 1


@pytest.mark.usefixtures("quick")
def test_a_home_is_replaced_as_a_whole_or_not_at_all(folder: Path) -> None:
    """What a process leaves that ends while it makes a home does not refuse the next one."""

    def ended(database: Database) -> None:
        database.put_training(KNOWN, None, keep=False)
        os._exit(9)

    for path in (folder, folder.with_name("new")):
        path.mkdir(exist_ok=True)
        (path / "home.sqlite").touch()
        if not (process := os.fork()):
            try:
                _write(path, ended)
            finally:
                os._exit(1)
        assert os.waitstatus_to_exitcode(os.waitpid(process, 0)[1]) == 9
        larger = replace(KNOWN, entities=2 * KNOWN.entities)
        with Home(larger, create(larger, path)) as home:
            home.tell([FACTS[4]])
        with pytest.raises(InputError, match="1 changes"):
            create(KNOWN, path)
        with isi.open(path) as home:
            assert FACTS[4] in known(home)[0]


@pytest.mark.usefixtures("quick")
def test_another_program_cannot_write_facts_of_unknown_names(folder: Path) -> None:
    into = "INSERT INTO fact (head, relation, tail, status) VALUES"
    with isi.open(folder) as home:
        for statement in (
            f"{into} ('ufo', 'in', 'e1', 'added')",
            f"{into} (1, 1, 99, 'added')",
            f"{into} (1, 99, 1, 'added')",
            "UPDATE fact SET head = 99",
            "DELETE FROM entity WHERE name = 'e1'",
            "DELETE FROM relation",
        ):
            with pytest.raises(sqlite3.IntegrityError):
                edit(folder, statement)
        assert known(home) == known_after([])
        edit(folder, f"{into} (2, 1, 9, 'added')")
        assert len(home.facts()) == len(TRAINED) + 1


@pytest.mark.parametrize(
    ("content", "text"),
    [(b"", "empty"), (b"all of it", "not a database"), (b"\0" * 5000, "not a database")],
)
def test_a_file_of_another_program_stays_as_it_is(
    tmp_path: Path, content: bytes, text: str
) -> None:
    path = tmp_path / "home.sqlite"
    path.write_bytes(content)
    for durability in ("full", "memory"):
        with pytest.raises(InputError, match=text):
            isi.open(tmp_path, durability)  # type: ignore[arg-type]
    assert [*tmp_path.iterdir()] == [path]
    assert path.read_bytes() == content


@pytest.mark.parametrize("statement", ["CREATE TABLE note (x)", "PRAGMA application_id = 7"])
def test_a_database_of_another_program_stays_as_it_is(tmp_path: Path, statement: str) -> None:
    edit(tmp_path, statement)
    before = (tmp_path / "home.sqlite").read_bytes()
    for refused in (isi.open, partial(create, KNOWN)):
        with pytest.raises(InputError, match="another program"):
            refused(tmp_path)
    assert (tmp_path / "home.sqlite").read_bytes() == before


@pytest.mark.usefixtures("quick")
def test_a_check_names_what_is_damaged(folder: Path) -> None:
    with isi.open(folder) as home:
        home.tell([FACTS[7]])
        assert not home.database.faults()
        for statement, word in (
            ("UPDATE effect SET entity = 99 WHERE effect = 'inserted'", "effect"),
            ("UPDATE trained SET data = zeroblob(8) WHERE name = 'relations'", "relations"),
        ):
            edit(folder, statement)
            assert any(word in fault for fault in home.database.faults())
    file = folder / "home.sqlite"
    content = file.read_bytes().replace(b"e17", b"e99")
    file.write_bytes(content)
    with Database(folder) as database:
        assert any("index" in fault for fault in database.faults())


@pytest.mark.usefixtures("quick")
def test_what_is_seen_again_takes_little_room_which_forgetting_gives_back(folder: Path) -> None:
    def size() -> int:
        return (folder / "home.sqlite").stat().st_size

    with isi.open(folder) as home:
        home.tell(TRAINED[:50], source="camera")
    first = size()
    with isi.open(folder) as home:
        home.database.execute("PRAGMA synchronous = OFF")
        for _ in range(200):
            home.tell(TRAINED[:50], source="camera")
    assert size() < first + 200 * 50 * 30
    with isi.open(folder) as home:
        before = known(home)
        assert forget(home.database, "9999-01-01T00:00:00Z") == 201
        assert known(home) == before
        assert [change.verb for change in home.history()] == ["forget"]
        with pytest.raises(InputError, match="no change"):
            home.undo()
        with pytest.raises(InputError, match="changes"):
            create(KNOWN, folder)
    assert size() <= first
