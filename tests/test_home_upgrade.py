"""A home of version 1 of the database, with a file of vectors beside it, is opened and upgraded."""

import json
import sqlite3
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import isi
from isi.errors import InputError
from isi.home.home import Home
from tests.small_bundle import files

pytestmark = pytest.mark.usefixtures("quick")
#: The database, its file of vectors, and what the code of that version said of them.
OLD = Path(__file__).with_name("home_of_version_1.sql")


@pytest.fixture
def old(tmp_path: Path) -> tuple[Path, dict[str, Any]]:
    with closing(sqlite3.connect(tmp_path / "home.sqlite")) as database:
        database.executescript(OLD.read_text("utf-8"))
        ((name, content),) = database.execute("SELECT * FROM file").fetchall()
        ((expected,),) = database.execute("SELECT * FROM expected").fetchall()
        database.executescript("DROP TABLE file; DROP TABLE expected; PRAGMA journal_mode = WAL")
    (tmp_path / name).write_bytes(content)
    return tmp_path, json.loads(expected)


def facts(home: Home) -> list[list[Any]]:
    """The facts that hold, without their ids."""
    return sorted([list(vars(row).values())[1:] for row in home.facts()], key=str)


def without_ids(rows: list[list[Any]]) -> list[list[Any]]:
    return sorted([row[1:] for row in rows], key=str)


def assert_as_before(home: Home, expected: dict[str, Any]) -> None:
    assert facts(home) == without_ids(expected["facts"])
    history = [{**vars(change), "time": change.time.isoformat()} for change in home.history()]
    assert json.loads(json.dumps(history)) == expected["history"]
    np.testing.assert_array_equal(home.base.entities, expected["entities"])
    for name, vector in expected["vectors"].items():
        np.testing.assert_array_equal(home.inserted[name].vector, vector)
    answers = [
        [best.entity, best.score, best.given]
        for query in (("mug", "atLocation"), ("stove", "near"))
        for best in home.ask(*query).answers
    ]
    assert [(name, given) for name, _, given in answers] == [
        (name, given) for name, _, given in expected["answers"]
    ]
    scores, before = ([row[1] for row in rows] for rows in (answers, expected["answers"]))
    np.testing.assert_allclose(scores, before, atol=1e-6)


@pytest.mark.parametrize("durability", ["full", "memory"])
def test_a_home_of_version_1_is_upgraded_with_all_that_it_knows_and_can_undo(
    old: tuple[Path, dict[str, Any]], durability: Any
) -> None:
    folder, expected = old
    before = files(folder)
    with isi.open(folder, durability) as home:
        assert_as_before(home, expected)
        assert not home.database.faults()
        for undone in expected["undone"]:
            home.undo()
            assert facts(home) == without_ids(undone)
        with pytest.raises(InputError):
            home.undo()
    if durability == "memory":
        assert files(folder) == before
    else:  # the file of vectors is read no more
        next(folder.glob("vectors-*")).unlink()
        with isi.open(folder) as home:
            assert facts(home) == without_ids(expected["undone"][-1])


def test_an_upgrade_that_fails_leaves_the_home_as_it_was(
    old: tuple[Path, dict[str, Any]],
) -> None:
    folder, expected = old
    vectors = next(folder.glob("vectors-*"))
    moved = vectors.rename(folder / "moved")
    before = files(folder)
    for durability in ("full", "memory"):
        with pytest.raises(InputError, match="vectors-"):
            isi.open(folder, durability)  # type: ignore[arg-type]
    moved.write_bytes(moved.read_bytes()[:-1])
    moved.rename(vectors)
    with pytest.raises(InputError, match="digest"):
        isi.open(folder)
    assert files(folder)["home.sqlite"] == before["home.sqlite"]
    vectors.write_bytes(before["moved"])
    with isi.open(folder) as home:
        assert_as_before(home, expected)
