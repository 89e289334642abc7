"""``insert_rows`` with a table of entities in parts on two Dask workers,
as with the table on one machine.
"""

import os
import signal
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from isi.errors import InputError
from isi.initializers.similarity import WHOLE
from isi.insertion.large import insert_rows
from isi.insertion.workers import on_workers
from tests.dask_cluster import Cluster, two_workers
from tests.small_graphs import random_embedding

distributed = pytest.importorskip("distributed")

LARGE, SMALL, RELATIONS, DIMENSION = 5000, 60, 3, 8
assert LARGE**2 > WHOLE > SMALL**2


@pytest.fixture(scope="module")
def cluster(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Cluster]:
    with two_workers(tmp_path_factory.mktemp("cluster")) as started:
        yield started


@pytest.fixture
def client(cluster: Cluster) -> Iterator[Any]:
    with distributed.Client(cluster.scheduler, set_as_default=False) as connected:
        yield connected


def graph(entities: int) -> dict[str, Any]:
    """Arguments of ``insert_rows`` for three new entities with one to five triples."""
    stack, rng = random_embedding(1, entities, RELATIONS, DIMENSION), np.random.default_rng(0)
    triples = [
        [rng.integers(entities), rng.integers(RELATIONS), entities + place]
        for place, number in enumerate((2, 5, 1))
        for _ in range(number)
    ]
    known = np.stack([rng.integers(0, most, 200) for most in (entities, RELATIONS, entities)], 1)
    return {
        "entities": stack.entity[0].numpy(),
        "relations": stack.relation[0].numpy(),
        "triples": np.array(triples),
        "new": 3,
        "model": "complex",
        "known_triples": known,
    }


def files_of(folder: Path, entities: np.ndarray, *ends: int) -> list[Path]:
    """The rows up to each of ``ends``, and the rest, in a file each."""
    files = [folder / f"{number}.npy" for number in range(len(ends) + 1)]
    for file, rows in zip(files, np.split(entities, ends), strict=True):
        np.save(file, rows)
    return files


@pytest.mark.parametrize(
    ("entities", "name"),
    [
        (LARGE, name)
        for name in (
            "map",
            "map_mean",
            "ridge",
            "soft_rs",
            "rs",
            "mean",
            "neighbour_mean",
            "er_avg",
        )
    ]
    + [(SMALL, name) for name in ("map", "iu", "class_noise")],
)
@pytest.mark.parametrize("ends", [(), (33,), (7, 7 + 20)], ids=["one file", "two", "three"])
def test_rows_are_those_of_the_table_on_one_machine(
    entities: int, name: str, ends: tuple[int, ...], client: Any, tmp_path: Path
) -> None:
    given = graph(entities)
    parts = on_workers(client, files_of(tmp_path, given["entities"], *ends))
    rows = insert_rows(**given | {"entities": parts}, initializer=name)
    np.testing.assert_allclose(rows, insert_rows(**given, initializer=name), rtol=1e-4, atol=1e-5)


def note_tables() -> None:
    """From now on, note the tables that this process opens."""
    sys.tables = set()  # type: ignore[attr-defined]

    def note(event: str, arguments: tuple[Any, ...]) -> None:
        if event == "open" and str(arguments[0]).endswith(".npy"):
            sys.tables.add(Path(arguments[0]).name)  # type: ignore[attr-defined]

    sys.addaudithook(note)


def test_a_worker_reads_its_part_and_the_client_gets_few_rows(
    client: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    given = graph(LARGE)
    parts = on_workers(client, files_of(tmp_path, given["entities"], LARGE // 2))
    client.run(note_tables)
    received, gather = list[int](), client.gather

    def noted(futures: list[Any]) -> list[np.ndarray]:
        results: list[np.ndarray] = gather(futures)
        received.append(sum(result.size for result in results))
        return results

    monkeypatch.setattr(client, "gather", noted)
    monkeypatch.setattr(np.lib.format, "open_memmap", None)  # in this process
    insert_rows(**given | {"entities": parts}, initializer="map")
    assert sorted(client.run(lambda: sorted(sys.tables)).values()) == [["0.npy"], ["1.npy"]]  # type: ignore[attr-defined]
    assert 0 < max(received) < LARGE * DIMENSION / 2


def test_a_large_table_is_never_gathered(client: Any, tmp_path: Path) -> None:
    given = graph(LARGE)
    parts = on_workers(client, files_of(tmp_path, given["entities"]))
    with pytest.raises(InputError, match="argument 'initializer'"):
        insert_rows(**given | {"entities": parts}, initializer="iu")


WIDE, TEXT, WRONG = (
    np.zeros((1, 9), np.float32),
    np.array([["a"]]),
    np.array([[1.0] * 8, [np.nan] * 8]),
)


@pytest.mark.parametrize(
    ("second", "named"),
    [(WIDE, r"1\.npy.* 8 .* 9"), (TEXT, r"1\.npy"), (WRONG, "row 60"), (np.float32(1), r"1\.npy")],
)
def test_a_wrong_table_is_named(
    second: np.ndarray, named: str, client: Any, tmp_path: Path
) -> None:
    files = files_of(tmp_path, graph(SMALL)["entities"], SMALL - 1)
    np.save(files[1], second)
    with pytest.raises(InputError, match=named):
        on_workers(client, files)


def test_wrong_files_and_clients_are_named(client: Any, cluster: Cluster, tmp_path: Path) -> None:
    other = tmp_path / "entities.csv"
    other.write_text("0.5,0.25\n", encoding="utf-8")
    for files, named in (
        ([other], "entities.csv"),
        ([tmp_path / "no.npy"], "no.npy"),
        ([], "files"),
        ("a", "files"),
    ):
        with pytest.raises(InputError, match=named):
            on_workers(client, files)
    with pytest.raises(InputError, match="argument 'client'"):
        on_workers(cluster.scheduler, [other])


def test_another_worker_reads_the_part_of_a_lost_one(
    client: Any, cluster: Cluster, tmp_path: Path
) -> None:
    given = graph(SMALL)
    parts = on_workers(client, files_of(tmp_path, given["entities"]))
    os.kill(next(iter(cluster.workers)), signal.SIGKILL)
    rows = insert_rows(**given | {"entities": parts})
    np.testing.assert_allclose(rows, insert_rows(**given), rtol=1e-4, atol=1e-5)
