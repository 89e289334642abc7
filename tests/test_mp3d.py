"""Matterport3D: tallies, headers of houses, and what ships (`read_files.yaml` has houses)."""

from pathlib import Path
from typing import Any

import pandas as pd
import pytest
import yaml

from isi.config import read as read_params
from isi.errors import InputError
from isi.sources import settings_of
from isi.sources.ai2thor import read_shares, reported_materials
from isi.sources.mp3d import STEPS
from isi.sources.recordings import AFFORDANCES, ITHOR, locate, read_recording
from isi.tables import paths
from stages.files import DEFINITIONS
from tests.observing import observations_of

LABELS = {"b": "bedroom", "k": "kitchen"}
HOUSE: str = yaml.safe_load((Path(__file__).parent / "read_files.yaml").read_text("utf-8"))[
    "mp3d_houses"
][0]["files"]["houses/x.house"]
WORDS = (
    "structure: [wall, unknown, void]\nsame_as: {night stand: side table, refridgerator: fridge}\n"
)


def write(path: Path, content: str) -> None:
    path.write_bytes(content.encode())


def mined(
    reader: str, vocabulary: Path, **settings: object
) -> tuple[list[tuple[object, ...]], list[int]]:
    """Rows (scene, room, instance, head, tail, count),
    and the number of instances after each step.
    """
    observed = observations_of({"reader": reader, "vocabulary": str(vocabulary), **settings})
    assert set(observed.table["relation"]) == {"atLocation"}
    columns = ("scene", "room", "instance", "head", "tail", "count")
    return observed.rows(*columns), [observed.counts[step] for step in STEPS]


# Houses


@pytest.mark.parametrize("kind", ["I", "P 0f3a", "P 0 0", *"VSEOCRL"])
def test_a_header_that_counts_other_records_than_there_are_is_refused(
    tmp_path: Path, kind: str
) -> None:
    lines = HOUSE.splitlines()
    first = next(number for number, line in enumerate(lines) if line.startswith(f"{kind} "))
    write(tmp_path / "x.house", "\n".join(lines[:first] + lines[first + 1 :]))
    write(tmp_path / "words.yaml", WORDS)
    of_houses = {"folder": str(tmp_path), "category": "mpcat40", "rooms": LABELS}
    with pytest.raises(InputError, match=rf"^{tmp_path}/x\.house: line 2: .* records {kind[0]}"):
        mined("mp3d_houses", tmp_path / "words.yaml", **of_houses)


# Tallies

TALLIES = """object,room,count
fan,bedroom,3
fan,family room,2
fan,living room,1
fan,garage,7
night stand,bedroom,4
side table,bedroom,5
wall,bedroom,9
"""
ROOMS = {"bedroom": "bedroom", "living room": "living room", "family room": "living room"}


def test_tallies_add_up_over_region_types_and_names_of_one_meaning(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write(tmp_path / "words.yaml", WORDS)
    write(tmp_path / "tallies.csv", TALLIES)
    monkeypatch.setattr(paths, "MP3D_TALLIES", tmp_path / "tallies.csv")
    rows, left = mined("mp3d_tallies", tmp_path / "words.yaml", rooms=ROOMS)
    assert rows == [
        (None, "bedroom", None, "fan", "bedroom", 3),
        (None, "living room", None, "fan", "living room", 3),
        (None, "bedroom", None, "side table", "bedroom", 9),
    ]
    assert left == [31, 31, 24, 15]


# What ships


def settings(source: str) -> dict[str, Any]:
    """The settings of a source in params.yaml."""
    return settings_of(read_params(paths.PARAMS)["sources"][source], f"sources.{source}")[1]


def shipped_words() -> dict[str, Any]:
    return read_params(Path(settings("mp3d")["vocabulary"]))


@pytest.fixture(scope="module")
def published() -> pd.DataFrame:
    return pd.read_csv(paths.MP3D_TALLIES, keep_default_na=False)


def test_the_mined_tallies_add_up_to_the_published_ones(published: pd.DataFrame) -> None:
    assert (published["object"].nunique(), published["room"].nunique()) == (197, 27)
    rooms = settings("mp3d")["rooms"]
    rows, left = mined("mp3d_tallies", Path(settings("mp3d")["vocabulary"]), rooms=rooms)
    lounging = published["room"].isin(["living room", "family room", "lounge"])
    in_rooms = published[lounging | published["room"].isin(["bathroom", "bedroom", "kitchen"])]
    structure = [
        "banister",
        "column",
        "door",
        "furniture",
        "handle",
        "railing",
        "stairs",
        "window",
        "window frame",
    ]
    no_structure = in_rooms[~in_rooms["object"].isin(structure)]
    assert left == [30_038, 30_038, in_rooms["count"].sum(), no_structure["count"].sum()]
    counts = {(head, room): count for _, room, _, head, _, count in rows}
    assert len(counts) == len(rows)
    assert sum(counts.values()) == left[-1]
    living = published[lounging].groupby("object")["count"].sum()
    assert counts["ottoman", "living room"] == living["ottoman"]
    assert counts["footstool", "living room"] == living["foot rest"]
    indexed = published.set_index(["object", "room"])["count"]
    assert counts["side table", "bedroom"] == indexed["night stand", "bedroom"]


def test_names_lead_to_objects_of_ai2thor_or_are_new_and_have_a_definition(
    published: pd.DataFrame,
) -> None:
    of_ai2thor, words = settings("ai2thor"), shipped_words()
    things = [
        thing
        for scene in read_recording(locate(of_ai2thor["from_"]), of_ai2thor["sha256"])
        for thing in scene.objects
    ]
    shares = read_shares(paths.MATERIAL_SHARES, paths.MATERIAL_CATEGORIES)
    objects = {thing.name for thing in things}
    others = {
        material for materials in reported_materials(0, things) for material in materials
    } | set(shares.columns)
    others |= {name for pair in AFFORDANCES.values() for name in pair} | {
        plans.room for plans in ITHOR
    }
    assert set(words["same_as"].values()) - objects == {"drinking glass", "sheet of paper"}
    assert not set(words["same_as"]) & objects
    new = {
        words["same_as"].get(name, name)
        for name in set(published["object"]) - set(words["structure"])
    } - objects
    assert not new & others
    assert new <= set(pd.read_csv(DEFINITIONS)["phrase"])
    extension = read_params(paths.PARAMS)["experiments"]["transfer"]["graph"]["extend"]
    assert set(extension["always"]) <= new
