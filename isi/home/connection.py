"""A connection to the database of a home: its transactions, what its errors mean, and whether the
file that was opened is the one that is there.
"""

import os
import shutil
import sqlite3
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing, contextmanager, suppress
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple, Self, TypeVar

from isi.errors import InputError, at

R = TypeVar("R")
DATABASE = "home.sqlite"
LOG, INDEX = "-wal", "-shm"  #: Endings of the files that SQLite keeps beside it.
WAITING = 60.0  #: Seconds that a change waits for those of other processes.
SLICE = 0.01  #: Seconds between two tries.
LEAST_SPACE = 2**16  #: Free bytes of a disk that is not full: SQLite's index takes half of them.
#: What an error of SQLite means for a home, and what to do, by result code.
REMEDIES = {
    sqlite3.SQLITE_BUSY: "cannot be written: another program has been writing it for"
    f" {WAITING:.0f} seconds; let it save or end, and try again",
    sqlite3.SQLITE_READONLY: "cannot be written: check the permissions of the folder, of the file,"
    f" and of {DATABASE}{LOG} and {DATABASE}{INDEX} beside it",
    sqlite3.SQLITE_IOERR: "cannot be read or written: its disk is gone, fails, or has no room",
    sqlite3.SQLITE_CORRUPT: "cannot be read: it is damaged; put a copy back (isi check says more)",
    sqlite3.SQLITE_FULL: "cannot be written: the disk is full; make room, and try again",
    sqlite3.SQLITE_CANTOPEN: "cannot be opened: check that its folder is there, and the permissions"
    " of what is in it",
    sqlite3.SQLITE_NOTADB: "cannot be read: it is not a database; put a copy back",
    sqlite3.SQLITE_CONSTRAINT: "has rows that do not fit together, by another program; put a copy"
    " back (isi check says more)",
    sqlite3.SQLITE_NOMEM: "cannot be read or written: there is not enough memory",
    sqlite3.SQLITE_TOOBIG: "cannot be written: a table of vectors may have at most 1 GB",
}
REMEDIES[sqlite3.SQLITE_LOCKED] = REMEDIES[sqlite3.SQLITE_BUSY]


class DatabaseFailure(InputError):
    """An error of SQLite, with what to do."""

    def __init__(self, path: str, folder: Path | None, error: sqlite3.Error) -> None:
        code = (getattr(error, "sqlite_errorcode", None) or sqlite3.SQLITE_ERROR) & 0xFF
        if code == sqlite3.SQLITE_IOERR and folder is not None:
            with suppress(OSError):
                if shutil.disk_usage(folder).free < LEAST_SPACE:
                    code = sqlite3.SQLITE_FULL
        self.is_locked = code in (sqlite3.SQLITE_BUSY, sqlite3.SQLITE_LOCKED)
        super().__init__(path, "", REMEDIES.get(code, f"cannot be read or written ({error})"))


def patiently(attempt: Callable[[], R], waiting: float = WAITING) -> R:
    """Try again, for some seconds, while another program writes."""
    end = time.monotonic() + waiting
    while True:
        try:
            return attempt()
        except DatabaseFailure as error:
            if not error.is_locked or time.monotonic() >= end:
                raise
        time.sleep(SLICE)


class Marks(NamedTuple):
    """What tells the files of a database from others."""

    file: tuple[int, int] | None  #: device and inode
    log: tuple[int, int] | None
    content: tuple[int, int] | None  #: size and time
    of_log: Any  #: of a database that is read alone: what tells its log from a longer one


class Connection:
    """A connection to the database of a folder, or to one in memory. Several threads may use it in
    turn. No transaction begins by itself.
    """

    def __init__(self, folder: Path | None = None, refusal: str = "") -> None:
        """Connect to the database of a folder, or to a new one in memory.

        ``refusal``: why it is not to be changed. Then no file is written: a copy in memory is read,
        which is taken again whenever the files are others.
        """
        self.folder = folder  #: None in memory
        self.refusal = refusal  #: empty if it may be changed
        self._path = str((folder or Path()).absolute() / DATABASE)
        self._log = f"{self._path}{LOG}"
        self._process = os.getpid()
        self._copies = 0
        self._opened = self._marks()
        self._seen = 0, 0  #: version and last change
        self._connection: sqlite3.Connection | None = self._connected()

    def _connected(self) -> sqlite3.Connection:
        is_in_memory = self.folder is None or self.is_read_only
        with self._in_words():
            connection = sqlite3.connect(
                ":memory:" if is_in_memory else self._path,
                timeout=0,
                isolation_level=None,
                check_same_thread=False,
            )
            connection.execute("PRAGMA foreign_keys = 1")
            if self.is_read_only and (content := content_of(Path(self._path))):
                connection.deserialize(content)
                self._copies += 1
        return connection

    def use(self, beside: Path | None = None) -> None:
        """Prepare a database that was connected."""

    def copy_into(self, other: "Connection") -> None:
        """Make another database a copy of this one."""
        with self._in_words():
            self.connection.backup(other.connection)

    def keep_log(self) -> None:
        """Keep changes in a log beside the database, which from now on has to stay there."""
        if self.value("PRAGMA journal_mode = WAL") != "wal":
            no_log = (
                "cannot have a log beside it on this file system: choose a folder of a local disk"
            )
            raise InputError(self.path, "", no_log)
        self.rows("SELECT 1 FROM sqlite_master")
        self._opened = self._marks()._replace(file=self._opened.file)

    @property
    def connection(self) -> sqlite3.Connection:
        """``InputError`` after ``close``."""
        if self._connection is None:
            raise InputError(self.folder or "this embedding", "", "is closed: open it again")
        return self._connection

    @property
    def is_closed(self) -> bool:
        return self._connection is None

    @property
    def is_read_only(self) -> bool:
        return bool(self.refusal)

    def close(self) -> None:
        """Close the database; a second time, nothing."""
        if self._connection is not None:
            self._connection.close()
        self._connection = None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @property
    def path(self) -> str:
        """Of the database, for messages."""
        return str(self.folder / DATABASE) if self.folder else "home"

    # -- whether it is there -----------------------------------------------------------------------

    def look(self) -> None:
        """``InputError`` unless this process has opened the file that is there. A copy in memory is
        taken again if the files are others.
        """
        if self._process != os.getpid():
            fork = "was opened by the process that this one is a fork of: open it again here"
            raise InputError(self.path, "", fork)
        marks, opened = self._marks(), self._opened
        if self.folder is None or self._connection is None or marks == opened:
            return
        if self.is_read_only and marks.file is not None:
            self._opened = marks
            self._connection = self._connected()
            self.use()
            return
        if marks.file is None:
            why = "was deleted or moved while it was open: open it where it is now"
        elif marks.file != opened.file:
            why = "was replaced by another file while it was open: open it again"
        elif opened.log not in (None, marks.log):
            if marks.log is None:  # what is in the deleted log alone is saved
                with suppress(sqlite3.Error):
                    self._connection.execute("PRAGMA wal_checkpoint")
            why = f"lost its log, {DATABASE}{LOG}, while it was open: open it again"
        elif marks.content == opened.content or self._has_all():
            self._opened = marks
            return
        else:
            why = "was overwritten while it was open (a copy was put back?): open it again"
        raise InputError(self.path, "", why)

    def _has_all(self) -> bool:
        """Whether the file has the last change that was seen, since something has been written into
        it.
        """
        if self._seen[0] != self.value("PRAGMA data_version"):
            return True  # a change of another process
        try:
            with closing(sqlite3.connect(self._path)) as other:
                ((last,),) = other.execute("SELECT max(id) FROM change").fetchall()
                sound = other.execute("PRAGMA quick_check(1)").fetchall() == [("ok",)]
        except sqlite3.Error:
            return False
        return sound and last >= self._seen[1]

    def _marks(self) -> Marks:
        head = b""
        if self.is_read_only:
            with suppress(OSError), Path(f"{self._path}{INDEX}").open("rb") as index:
                head = index.read(48)
        (file, content), (log, log_content) = _mark(self._path), _mark(self._log)
        return Marks(file, log, content, (log_content, head) if self.is_read_only else None)

    def version(self) -> int:
        """A number that changes when another connection changes the database."""
        version = int(self.value("PRAGMA data_version"))
        if version != self._seen[0]:
            self._see(version)
        return self._copies or version

    def _see(self, version: int) -> None:
        """Remember the last change."""
        self._seen = version, int(self.value("SELECT max(id) FROM change") or 0)

    # -- statements --------------------------------------------------------------------------------

    def rows(self, query: str, *values: Any) -> list[Any]:
        """The rows of a query."""
        if not self.connection.in_transaction:
            return patiently(partial(self._rows, query, values))
        return self._rows(query, values)

    def _rows(self, query: str, values: Sequence[Any]) -> list[Any]:
        with self._in_words():
            return self.connection.execute(query, values).fetchall()

    def value(self, query: str, *values: Any) -> Any:
        """The value of a query for one; None without a row."""
        return next((row[0] for row in self.rows(query, *values)), None)

    def execute(self, statement: str, *values: Any) -> int:
        """Change something; the id of the row that was inserted last."""
        with self._in_words():
            return int(self.connection.execute(statement, values).lastrowid or 0)

    @contextmanager
    def _in_words(self) -> Iterator[None]:
        """Turn errors of SQLite into an ``InputError`` with the file and what to do."""
        try:
            yield
        except sqlite3.Error as error:
            raise DatabaseFailure(self.path, self.folder, error) from error

    @contextmanager
    def transaction(self, waiting: float = WAITING, of_copy: bool = False) -> Iterator[None]:
        """All that is done inside, or nothing; it is durable afterwards. One inside another is a
        part of it.

        ``waiting``: seconds for another program that writes; then a ``DatabaseFailure`` that
        ``is_locked``. ``of_copy``: a copy in memory that is read alone may be changed, too.
        """
        if self.connection.in_transaction:
            yield
            return
        self.look()
        if self.is_read_only and not of_copy:
            raise InputError(self.path, "", self.refusal)
        patiently(partial(self.execute, "BEGIN IMMEDIATE"), waiting)
        try:
            with self._in_words():
                yield
            self.look()
            patiently(partial(self.execute, "COMMIT"))
            if self.folder is not None and not self.is_read_only:
                self._opened = self._opened._replace(content=_mark(self._path)[1])
                self._see(self._seen[0])
        except BaseException:
            with suppress(sqlite3.Error):
                self.connection.rollback()
            raise

    @contextmanager
    def snapshot(self) -> Iterator[None]:
        """All that is read inside is of one moment."""
        if self.connection.in_transaction:
            yield
            return
        self.look()
        self.execute("BEGIN")
        try:
            patiently(partial(self.rows, "SELECT 1 FROM setting LIMIT 1"))
            yield
        finally:
            if self._connection is not None:
                self._connection.rollback()


def _mark(path: str) -> tuple[tuple[int, int] | None, tuple[int, int] | None]:
    """Device and inode, and size and time, of a file."""
    try:
        file = os.stat(path)  # noqa: PTH116  # at each call, in a third of the time
    except OSError:
        return None, None
    return (file.st_dev, file.st_ino), (file.st_size, file.st_mtime_ns)


def content_of(file: Path) -> bytes:
    """The content of a database and of its log, as they are at one moment, without a file beside
    them that SQLite would write. No connection of this process may have it open.
    """
    log, before = file.with_name(f"{file.name}{LOG}"), None
    with at(file):
        while True:
            content = file.read_bytes(), log.read_bytes() if log.exists() else b""
            if content == before:
                break
            before = content
    database, changes = content
    if changes:
        with TemporaryDirectory() as folder:
            copy = Path(folder) / file.name
            copy.write_bytes(database)
            copy.with_name(log.name).write_bytes(changes)
            with closing(sqlite3.connect(copy)) as connection:
                connection.execute("PRAGMA wal_checkpoint(TRUNCATE)")
            database = copy.read_bytes()
    # without a log: its header says that it has none
    return database[:18] + b"\x01\x01" + database[20:]
