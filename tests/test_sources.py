"""Sources as data: registered in one place, with settings from signatures,
and named in error messages.
"""

import gzip
from collections.abc import Callable, Iterator
from importlib.metadata import PackageNotFoundError
from pathlib import Path

import pandas as pd
import pytest

from isi.config import Count, read
from isi.errors import InputError
from isi.sources import (
    READERS,
    Mining,
    Observation,
    Source,
    reader,
    readers,
    recordings,
    settings_of,
)
from isi.sources.names import household
from isi.tables import paths
from tests.observing import source_of

MP3D = read(paths.PARAMS)["sources"]["mp3d"]
HOUSES = {
    **MP3D,
    "reader": "mp3d_houses",
    "folder": "houses",
    "category": "mpcat40",
    "rooms": {"k": "kitchen"},
}


def of_kind(triples: pd.DataFrame, rooms: set[str]) -> pd.DataFrame:
    """Entities with kinds that homes do not have."""
    assert rooms == {"sea"}
    names = sorted({*triples["head"], *triples["tail"]})
    return pd.DataFrame({"entity": names, "kind": "animal", "phrase": names})


@reader("pretended", of_kind)
def pretended(mining: Mining, fish: Count, name: str = "cod") -> Iterator[Observation]:
    """A reader that yields ``fish`` observations."""
    for number in range(fish):
        mining.counts["fish"] += 1
        yield "scene", "sea", str(number), name, "eats", "crab", 1


def test_a_source_observes_with_its_settings_and_counts(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("isi.sources.CHUNK", 2)
    source = Source({"reader": "pretended", "fish": 3}, "sources.mine", 0)
    assert [list(frame["head"]) for frame in source.frames()] == [["cod"] * 2, ["cod"]]
    assert source.kinds.to_numpy().tolist() == [
        ["cod", "animal", "cod"],
        ["crab", "animal", "crab"],
    ]
    assert source.counts == {"fish": 3}


@pytest.mark.parametrize(
    ("values", "key"),
    [
        (None, ".*dictionary"),
        ({"reader": "whales"}, "reader: expected one of .*pretended.*'whales'"),
        ({**HOUSES, "category": "nyu40"}, "category: "),
        ({**HOUSES, "rooms": {"q": "kitchen"}}, "rooms"),
    ],
)
def test_settings_that_a_source_does_not_take_are_refused_by_their_key(
    values: object, key: str
) -> None:
    with pytest.raises(InputError, match=rf"^params\.yaml: sources\.mine[.:]{key}"):
        settings_of(values, "sources.mine")


@pytest.mark.parametrize(
    ("kinds", "name"),
    [(["cod"], "crab"), (["cod", "crab", "cod"], "cod")],
    ids=["none of it", "two of it"],
)
def test_a_source_must_give_each_entity_one_kind_and_before_its_observations_are_whole(
    kinds: list[str], name: str
) -> None:
    named = pd.DataFrame({"entity": kinds, "kind": "animal", "phrase": kinds})
    frames = source_of(pretended(Mining(0), fish=2), lambda _triples, _rooms: named).frames()
    assert len(next(frames)) == 2
    with pytest.raises(InputError, match=f"entity '{name}'"):
        next(frames)


@pytest.mark.parametrize(
    ("rows", "expected"),
    [
        ([], "expected observations, got none"),
        ([("mug", 1), ("mu\tg", 1)], r"expected a name without .*'mu\\tg'"),
        (
            [("mug", 600_000_000), ("cup", 600_000_000)],
            "expected at most 1,000,000,000 observations",
        ),
    ],
)
def test_observations_that_are_missing_misnamed_or_too_many_are_refused(
    rows: list[tuple[str, int]], expected: str
) -> None:
    source = source_of(
        (None, None, None, head, "atLocation", "kitchen", count) for head, count in rows
    )
    with pytest.raises(InputError, match=f"^sources.given: {expected}"):
        list(source.frames())


# Files


@pytest.mark.parametrize(
    ("find", "expected"),
    [
        (
            lambda: list(READERS.get("behavior").read(Mining(0), "package", [], {}, {})),
            "package bddl: not installed",
        ),
        (lambda: recordings.locate("recording"), "package procthor: not installed"),
    ],
)
def test_a_package_must_be_there_to_be_read(
    monkeypatch: pytest.MonkeyPatch, find: Callable[[], object], expected: str
) -> None:
    def absent(_name: str) -> None:
        raise PackageNotFoundError

    monkeypatch.setattr("isi.sources.readers.distribution", absent)
    with pytest.raises(InputError, match=expected):
        find()


@pytest.mark.parametrize("name", ["log.ttl", "log.ttl.gz"])
def test_a_file_that_is_too_large_is_refused_before_it_is_held(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    monkeypatch.setattr(readers, "MOST", 1000)
    monkeypatch.setattr(readers, "MOST_ROWS", 2)
    content = b"entity\n" + b"mug\n" * 1000
    (tmp_path / name).write_bytes(gzip.compress(content) if name.endswith(".gz") else content)
    (tmp_path / "log.csv").write_bytes(content)
    with pytest.raises(InputError, match=f"{name}: expected Turtle of at most 1,000 characters"):
        readers.read_text(tmp_path / name, "Turtle")
    with pytest.raises(InputError, match=r"log\.csv: expected a table of at most 2 rows"):
        readers.read_table(tmp_path / "log.csv", ["entity"])


# Homes


def test_entities_of_a_home_are_in_alphabetical_order_with_their_kind_and_one_row_a_name() -> None:
    triples = [
        ("mug", "hasMaterial", "wood"),
        ("mug", "atLocation", "kitchen"),
        ("mug", "hasAffordance", "fill"),
        ("mug", "atLocation", "cabinet"),
        ("cabinet", "atLocation", "kitchen"),
    ]
    entities = household(
        pd.DataFrame(triples, columns=["head", "relation", "tail"]), {"kitchen", "bedroom"}
    )
    assert entities[["entity", "kind"]].to_numpy().tolist() == [
        ["cabinet", "object"],
        ["fill", "affordance"],
        ["kitchen", "room"],
        ["mug", "object"],
        ["wood", "material"],
    ]
    assert entities["phrase"].equals(entities["entity"])
