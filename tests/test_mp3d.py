"""Matterport3D: observations from tallies and from houses, in AI2-THOR's vocabulary."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pandas as pd
import pytest

from isi.config import read as read_params
from isi.errors import InputError
from isi.sources import settings_of
from isi.sources.ai2thor import read_shares, reported_materials
from isi.sources.mp3d import STEPS
from isi.sources.recordings import AFFORDANCES, ITHOR, locate, read_recording
from isi.tables import paths
from tests.observing import observations_of

LABELS = {"a": "bathroom", "t": "bathroom", "b": "bedroom", "k": "kitchen", "l": "living room"}
WORDS = (
    "structure: [wall, unknown, void]\nsame_as: {night stand: side table, refridgerator: fridge}\n"
)


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


def mined_houses(
    folder: Path, category: str = "category_mapping_name"
) -> tuple[list[tuple[object, ...]], list[int]]:
    write(folder / "words.yaml", WORDS)
    return mined(
        "mp3d_houses", folder / "words.yaml", folder=str(folder), category=category, rooms=LABELS
    )


# Houses

REGIONS = ((0, "b"), (1, "t"), (2, "Z"), (3, "-"), (4, "?"), (5, "k"))
CATEGORIES = [
    (0, "night#stand", "chest_of_drawers"),
    (1, "Towel", "towel"),
    (2, "unknown", "void"),
    (7, "wall", "wall"),
]
#: (object, region, category)
OBJECTS = (
    # in rooms; the last two are structure
    (0, 0, 0),
    (1, 0, 0),
    (2, 1, 1),
    (3, 5, 1),
    (4, 0, 2),
    (5, 5, 7),
    (6, 2, 1),
    (7, 3, 1),
    (8, 4, 1),
    (9, -1, 1),
    (10, 0, -1),
    (11, -1, -1),
)
#: By category_mapping_name: scene, room, instance, head, tail, count.
EXPECTED = [
    ("17DRP5sb8fy", "bedroom", "0", "side table", "bedroom", 1),
    ("17DRP5sb8fy", "bedroom", "1", "side table", "bedroom", 1),
    ("17DRP5sb8fy", "bathroom", "2", "towel", "bathroom", 1),
    ("17DRP5sb8fy", "kitchen", "3", "towel", "kitchen", 1),
]
#: How many images, panoramas, vertices, surfaces, segments, portals and levels the house below has.
IMAGES, PANORAMAS, VERTICES, SURFACES, SEGMENTS, PORTALS, LEVELS = 2, 1, 3, 1, 2, 1, 1
BOX, ZEROS = "-1.5 0 0 2 3e-1 2.4", "0 0 0 0 0"


def house(
    objects: Sequence[tuple[int, int, int]] = OBJECTS,
    regions: Sequence[tuple[int, str]] = REGIONS,
    version: str = "1.1",
    name: str = "17DRP5sb8fy",
) -> str:
    """The text of a house with these objects and regions, and with ``CATEGORIES``."""
    counts = {
        "1.0": (IMAGES, PANORAMAS, VERTICES, SURFACES, len(regions), LEVELS),
        "1.1": (
            IMAGES,
            PANORAMAS,
            VERTICES,
            SURFACES,
            SEGMENTS,
            len(objects),
            len(CATEGORIES),
            len(regions),
            PORTALS,
            LEVELS,
        ),
    }[version]
    counted = " ".join(map(str, counts))
    portals = [f"P 0 0 1 - {BOX} 0 0 0 0"] * PORTALS if version == "1.1" else []
    return (
        "\n".join(
            [
                f"ASCII {version}",
                f"H {name} - {counted} {BOX} {ZEROS} 0 0 0"
                if version == "1.0"
                else f"H {name} -  {counted}  {ZEROS}  {BOX}  {ZEROS}",
                *[f"L 0 {len(regions)} - 0 0 0 {BOX} {ZEROS}"] * LEVELS,
                *[
                    f"R {number} 0 0 0 {label}  1 2 3  {BOX}  2.5  0 0 0 0"
                    for number, label in regions
                ],
                *portals,
                *[f"S 0 0 0 - 1 2 3 0 0 1 {BOX} {ZEROS}"] * SURFACES,
                *["V 0 0 - 1 2 3 0 0 1 0 0 0"] * VERTICES,
                *[f"P 0f3a 0 0 0 1 2 3 {ZEROS}"] * PANORAMAS,
                *[f"I 0 0 0f3a 0 0 {'1 ' * 25}640 480 1 2 3 {ZEROS}"] * IMAGES,
                *[
                    f"C {number} 10 {mapping} 11 {mpcat40} {ZEROS}"
                    for number, mapping, mpcat40 in CATEGORIES
                ],
                *[
                    f"O {' '.join(map(str, numbers))} 1 2 3 1 0 0 0 1 0 1 1 1 {ZEROS} 0 0 0"
                    for numbers in objects
                ],
                *[f"E 0 0 7 1.5 1 2 3 {BOX} {ZEROS}"] * SEGMENTS,
            ]
        )
        + "\n"
    )


def write(path: Path, content: str) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(content.encode())


@pytest.mark.parametrize("version", ["1.0", "1.1"])
@pytest.mark.parametrize("line_end", ["\n", "\r\n"])
def test_objects_of_a_house_stand_in_the_room_of_their_region(
    tmp_path: Path, version: str, line_end: str
) -> None:
    write(tmp_path / "x.house", house(version=version).replace("\n", line_end))
    rows, left = mined_houses(tmp_path)
    assert rows == EXPECTED
    # three of no region or category; three in Z, - and ?; a wall and an unknown
    assert left == [12, 9, 6, 4]


def test_objects_go_by_the_other_name_where_params_say_so_in_lower_case_words(
    tmp_path: Path,
) -> None:
    write(tmp_path / "x.house", house().replace("chest_of_drawers", "Chest#of_drawers#"))
    heads = [row[3] for row in mined_houses(tmp_path, "mpcat40")[0]]
    assert heads == ["chest of drawers", "chest of drawers", "towel", "towel"]


def test_houses_are_found_in_folders_below_and_read_in_order(tmp_path: Path) -> None:
    write(tmp_path / "b/house_segmentations/b.house", house(name="b"))
    write(tmp_path / "a/deep/down/a.house", house(OBJECTS[2:3], name="a"))
    write(tmp_path / "a/deep/down/a.fsegs.json", "{}")
    write(tmp_path / "c.house", house(OBJECTS[6:], name="c"))
    rows, left = mined_houses(tmp_path)
    assert rows == [
        ("a", "bathroom", "2", "towel", "bathroom", 1),
        *[("b", *row[1:]) for row in EXPECTED],
    ]
    assert left == [19, 13, 7, 5]


@pytest.mark.parametrize("kind", ["I", "P 0f3a", "P 0 0", *"VSEOCRL"])
def test_a_header_that_counts_other_records_than_there_are_is_refused(
    tmp_path: Path, kind: str
) -> None:
    lines = house().splitlines()
    first = next(number for number, line in enumerate(lines) if line.startswith(f"{kind} "))
    write(tmp_path / "x.house", "\n".join(lines[:first] + lines[first + 1 :]))
    with pytest.raises(InputError, match=rf"^{tmp_path}/x\.house: line 2: .* records {kind[0]}"):
        mined_houses(tmp_path)


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
    assert new <= set(pd.read_csv(paths.DEFINITIONS)["phrase"])
    extension = read_params(paths.PARAMS)["experiments"]["transfer"]["graph"]["extend"]
    assert set(extension["always"]) <= new
