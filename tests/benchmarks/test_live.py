"""A home of the size of AI2-THOR's:
changes and queries in process and by the pipe of ``isi live``.

The peer of changes is ``isi.insert`` with the same initializer by name: what they cost beyond the
vector itself. The peer of a change that is written is a commit of SQLite with one row, on the same
disk.
"""

import json
import sqlite3
import subprocess
import sys
from collections.abc import Callable, Iterator
from itertools import count, cycle, islice, product
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import isi
from isi.home.bundle import Bundle, Fact, Manifest
from isi.home.home import Home

ENTITIES, DIMENSION, TRIPLES, OBJECTS = 145, 100, 1_009, 40
RELATIONS = ["at", "of", "for"]
MANY = 10_000  #: Facts between known entities, in a long life.
WAYS = [
    "isi.insert",
    "tell a new entity",
    "tell",
    "tell, 10,000 facts",
    "tell and ask, 10,000 facts",
    "ask",
    "tell, pipe",
    "ask, pipe",
]
CHANGES = 100_000  #: In the history of a home.
HOME_WAYS = [
    "SQLite's commit",
    "tell a known fact, durable",
    "tell a new fact, durable",
    "open, 100,000 changes",
    "ask after a change, 100,000 changes",
]


@pytest.fixture
def bundle() -> Bundle:
    rng = np.random.default_rng(0)
    entities, relations = (
        rng.standard_normal((rows, DIMENSION), np.float32) * 0.3 for rows in (ENTITIES, 3)
    )
    triples = np.unique(
        np.stack([rng.integers(0, most, 2 * TRIPLES) for most in (ENTITIES, 3, ENTITIES)], 1),
        axis=0,
    )
    names = [f"e{number}" for number in range(ENTITIES)]
    manifest = Manifest(model_name="analogy", model_options={}, words=None, made={})
    known = rng.permutation(triples)[:TRIPLES]
    return Bundle(manifest, entities, relations, names, [""] * ENTITIES, names, RELATIONS, known)


def fact(number: int) -> tuple[str, str, str]:
    """A fact about one of the inserted objects; another one for each number."""
    place = number // OBJECTS
    return f"object {number % OBJECTS}", RELATIONS[place % 3], f"e{place // 3 % ENTITIES}"


def long_life(bundle: Bundle) -> list[Fact]:
    """Many facts between known entities."""
    known = set(map(tuple, bundle.triples.tolist()))
    ids = product(range(ENTITIES), range(3), range(ENTITIES))
    rows = [row for row in ids if row not in known][:: ENTITIES * 3 * ENTITIES // MANY][:MANY]
    names = bundle.entity_names
    return [(names[head], RELATIONS[relation], names[tail]) for head, relation, tail in rows]


def of_object(bundle: Bundle, way: str) -> Callable[[], object]:
    home, numbers = Home(bundle), count()
    if "10,000" in way:
        home.tell(long_life(bundle))
    for number in range(OBJECTS):
        home.tell([(f"object {number}", "at", "e144")], initializer="map")
    if way == "isi.insert":
        ids = [[ENTITIES, 0, 144], [ENTITIES, 1, 5]]
        return lambda: isi.insert(
            bundle.entities,
            bundle.relations,
            ids,
            new=1,
            model="analogy",
            known_triples=bundle.triples,
            initializer="map",
        )

    def tell_new() -> object:
        name = f"new {next(numbers)}"
        return home.tell([(name, "at", "e144"), (name, "of", "e5")], initializer="map")

    def tell() -> object:
        return home.tell([fact(next(numbers))])

    def ask() -> object:
        return home.ask("object 0", "at")

    def tell_and_ask() -> object:
        return tell(), ask()

    if way == "tell a new entity":
        return tell_new
    if way.startswith("tell and ask"):
        return tell_and_ask
    return tell if way.startswith("tell") else ask


@pytest.fixture
def pipe(bundle: Bundle, tmp_path: Path) -> Iterator[Callable[[Any], Any]]:
    Home(bundle).save(tmp_path / "home")
    command = [sys.executable, "-m", "isi", "live", str(tmp_path / "home")]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as process:
        assert process.stdin
        assert process.stdout
        requests, answers = process.stdin, process.stdout

        def send(request: Any) -> Any:
            requests.write(json.dumps(request).encode() + b"\n")
            requests.flush()
            return json.loads(answers.readline())

        for number in range(OBJECTS):
            name = f"object {number}"
            assert "error" not in send({"tell": [[name, "at", "e144"]], "initializer": "map"})
        yield send
        requests.close()


@pytest.mark.parametrize("way", [way for way in WAYS if "pipe" not in way])
def test_in_process(benchmark: Any, bundle: Bundle, way: str) -> None:
    benchmark.group, work = "live", of_object(bundle, way)
    benchmark.extra_info.update(what=way)
    benchmark.pedantic(work, rounds=200, warmup_rounds=5)


@pytest.mark.parametrize("way", [way for way in WAYS if "pipe" in way])
def test_by_pipe(benchmark: Any, pipe: Callable[[Any], Any], way: str) -> None:
    """A request and its answer, after the process has had the time to prepare."""
    benchmark.group, numbers = "live", count()
    benchmark.extra_info.update(what=way)
    ask = way.startswith("ask")
    benchmark.pedantic(
        lambda: pipe({"ask": ["object 0", "at", None]} if ask else {"tell": [fact(next(numbers))]}),
        rounds=200,
        warmup_rounds=40,
    )


@pytest.mark.parametrize("way", HOME_WAYS)
def test_in_a_folder(benchmark: Any, bundle: Bundle, tmp_path: Path, way: str) -> None:
    folder, numbers, rounds = tmp_path / "home", count(), 200
    Home(bundle).save(folder)
    benchmark.group = "live"
    benchmark.extra_info.update(what=way)
    facts = bundle.named_triples() if "known" in way else long_life(bundle)
    if way.startswith("SQLite"):
        database = sqlite3.connect(tmp_path / "rows.sqlite", isolation_level=None)
        database.execute("PRAGMA journal_mode = WAL")
        database.execute("CREATE TABLE row (head, relation, tail)")
        benchmark.pedantic(lambda: database.execute("INSERT INTO row VALUES (1, 2, 3)"), rounds=200)
        return
    if "100,000" in way:
        rounds = 10
        with isi.open(folder) as home, home.database.transaction():
            for fact in islice(cycle(facts), CHANGES):
                home.tell([fact])

    def open_and_ask() -> object:
        with isi.open(folder) as opened:
            return opened.ask("e0", "at")

    def tell() -> object:
        return home.tell([facts[next(numbers)]])

    def tell_and_ask() -> object:
        home.remove(facts=[facts[next(numbers)]])
        return home.ask("e0", "at")

    with isi.open(folder) as home:
        work = open_and_ask if way.startswith("open") else tell
        benchmark.pedantic(tell_and_ask if "ask after" in way else work, rounds=rounds)
