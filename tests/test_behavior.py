"""BEHAVIOR-1K's scenes: from a small folder of the same form, from the package where it is, and from bad files."""

from __future__ import annotations

import json
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path
from typing import Any

import pandas as pd
import pyarrow as pa
import pytest

from isi.config import read as read_params
from isi.errors import InputError
from isi.sources import Mining, Observed, _rows
from isi.sources._household import household
from isi.sources.behavior import CATEGORIES, PROPERTIES, SCENES, STEPS, behavior
from isi.tables import paths

ROOT = Path(__file__).parent.parent
SETTINGS: dict[str, Any] = {
    "structure": ["wall.n.01"],
    "names": {"cabinet.n.03": "locker", "childs_room": "child's room"},
    "affordances": {"openable": ["open", "close"], "flammable": ["burn"], "heatSource": ["heat"], "fire": ["burn"]},
}
SCENE: dict[str, Any] = {
    "kitchen_0": {"stove-abcdef": 1, "bottom_cabinet-ghijkl": 2, "locker-aaaaaa": 1, "walls-bbbbbb": 4},
    "childs_room_1": {"bottom_cabinet-ghijkl": 1, "bottom_cabinet-mnopqr": 1},
}
MAPPED = "category,synset\nstove,stove.n.01\nbottom_cabinet,cabinet.n.01\nlocker,cabinet.n.03\nwalls,wall.n.01\n"
TOLD: dict[str, Any] = {
    "stove.n.01": {"heatSource": {}, "dustyable": {}},
    "cabinet.n.01": {"openable": {}, "flammable": {}, "fire": {}},
    "cabinet.n.03": {},
    "wall.n.01": {},
}


def folder_of(path: Path, scenes: object = None, mapped: str = MAPPED, told: object = TOLD) -> Path:
    """The files of the package, of one scene where nothing else is given."""
    content = {"success": True, "scenes": {"House_0": SCENE}} if scenes is None else scenes
    (path / SCENES).write_text(content if isinstance(content, str) else json.dumps(content), encoding="utf-8")
    (path / CATEGORIES).write_text(mapped, encoding="utf-8")
    (path / PROPERTIES).write_text(json.dumps(told), encoding="utf-8")
    return path


def mined(folder: Path | str, mining: Mining | None = None, **changes: object) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Observations, and kinds."""
    observed = Observed(household)
    parts = behavior(mining or Mining(0), from_=str(folder), **{**SETTINGS, **changes})
    return pa.concat_tables(observed.passing(parts)).to_pandas(), observed.kinds


def test_each_object_is_in_its_room_and_has_the_affordances_of_its_properties_once(tmp_path: Path) -> None:
    mining = Mining(0)
    observations, kinds = mined(folder_of(tmp_path), mining)
    assert set(observations["scene"]) == {"House_0"}
    seen = [
        (row.room, row.instance, row.head, row.relation, row.tail, row.count)
        for row in observations.itertuples(index=False)
    ]
    cabinets = [("kitchen", "kitchen_0/bottom_cabinet-ghijkl", 2),
                ("child's room", "childs_room_1/bottom_cabinet-ghijkl", 1),
                ("child's room", "childs_room_1/bottom_cabinet-mnopqr", 1)]  # fmt: skip
    expected = [
        ("kitchen", "kitchen_0/stove-abcdef", "stove", "atLocation", "kitchen", 1),
        ("kitchen", "kitchen_0/stove-abcdef", "stove", "hasAffordance", "heat", 1),
        ("kitchen", "kitchen_0/locker-aaaaaa", "locker", "atLocation", "kitchen", 1),
    ]
    for room, instance, count in cabinets:
        expected.append((room, instance, "cabinet", "atLocation", room, count))
        expected += [(room, instance, "cabinet", "hasAffordance", does, count) for does in ("burn", "close", "open")]
    assert sorted(seen) == sorted(expected)
    assert mining.left == dict(zip(STEPS, (10, 6), strict=True))
    assert dict(zip(kinds["entity"], kinds["kind"], strict=True)) == {
        "burn": "affordance", "cabinet": "object", "child's room": "room", "close": "affordance", "heat": "affordance",
        "kitchen": "room", "locker": "object", "open": "affordance", "stove": "object",
    }  # fmt: skip


def test_scenes_are_parts_of_their_own(tmp_path: Path) -> None:
    scenes = {"scenes": {"a": SCENE, "b": {"kitchen_0": {"stove-abcdef": 3}}}}
    parts = behavior(Mining(0), from_=str(folder_of(tmp_path, scenes)), **SETTINGS)
    assert [set(one.to_pandas()["scene"]) for one in parts] == [{"a"}, {"b"}]


def test_two_synsets_of_one_name_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"'cabinet': expected another name for cabinet\.n\.03 in the setting names"):
        mined(folder_of(tmp_path), names={})


@pytest.mark.parametrize(
    ("setting", "value", "named"),
    [
        ("structure", ["wall.n.02"], f"{CATEGORIES}: synset 'wall.n.02'"),
        ("affordances", {"openible": ["open"]}, f"{PROPERTIES}: property 'openible'"),
    ],
)
def test_what_a_setting_names_must_be_there(tmp_path: Path, setting: str, value: object, named: str) -> None:
    with pytest.raises(InputError, match=named):
        mined(folder_of(tmp_path), **{setting: value})


@pytest.mark.parametrize(
    ("settings", "named"),
    [
        ({"names": {**SETTINGS["names"], "stove.n.01": "../stove"}}, "'stove.n.01': expected a name without"),
        ({"names": {**SETTINGS["names"], "kitchen": "k" * 201}}, "'kitchen_0': expected a name of at most"),
        ({"affordances": {"openable": ["open\n"]}}, "affordances: expected a name without"),
    ],
)
def test_settings_give_names(tmp_path: Path, settings: dict[str, Any], named: str) -> None:
    with pytest.raises(InputError, match=named):
        mined(folder_of(tmp_path), **settings)


@pytest.mark.parametrize(
    ("word", "place"), [("st\u001bove", f"{CATEGORIES}: line 2: synset"), ("___", f"{SCENES}: House_0: kitchen_0: .*")]
)
def test_a_synset_without_words_is_refused(tmp_path: Path, word: str, place: str) -> None:
    told = {**TOLD, f"{word}.n.01": {}}
    with pytest.raises(InputError, match=f"{place}: expected a name"):
        mined(folder_of(tmp_path, mapped=MAPPED.replace("stove.n", f"{word}.n"), told=told))


def in_kitchen(**models: object) -> object:
    return {"scenes": {"House_0": {"kitchen_0": models}}}


@pytest.mark.parametrize(
    ("scenes", "place"),
    [
        ("", ""),
        ("[]", ""),
        ('{"scenes": {"House_0": {"kitchen_0": {"stove-abc', ""),
        ("[" * 100_000, ""),
        ("\udcff", ""),
        ({}, "scenes"),
        ({"scenes": {}}, "scenes"),
        ({"scenes": {"House_0": [SCENE]}}, "'House_0'"),
        (in_kitchen(**{"stove-abcdef": "1"}), "'stove-abcdef'"),
        (in_kitchen(**{"stove-abcdef": 0}), "'stove-abcdef'"),
        (in_kitchen(**{"stove-abcdef": 10**30}), "'stove-abcdef'"),
        (in_kitchen(stove=1), "House_0: kitchen_0: model 'stove'"),
        (in_kitchen(**{"oven-abcdef": 1}), "model 'oven-abcdef'"),
        (in_kitchen(**{"x" * 10_000 + "-abcdef": 1}), "model 'xxx"),
        (in_kitchen(**{"sto\u001bve-abcdef": 1}), r"model 'sto\x1bve-abcdef'"),
        ({"scenes": {"../House_0": SCENE}}, "scene '../House_0'"),
        ({"scenes": {"House_0": {"kitchen": SCENE["kitchen_0"]}}}, "House_0: room 'kitchen'"),
        ({"scenes": {"House_0": SCENE, "House_1": {}}}, "'House_1'"),
        ({"scenes": {"House_0": {"kitchen_0": {}}}}, "'House_0': 'kitchen_0'"),
    ],
)
def test_broken_scenes_are_refused_in_one_short_line(tmp_path: Path, scenes: object, place: str) -> None:
    folder = folder_of(tmp_path)
    if isinstance(scenes, str):
        (folder / SCENES).write_bytes(scenes.encode("utf-8", "surrogateescape"))
    else:
        folder_of(tmp_path, scenes)
    with pytest.raises(InputError) as refused:
        mined(folder)
    line = str(refused.value)
    assert line.startswith(f"{folder / SCENES}: ")
    assert place in line
    assert line.isprintable()
    assert len(line) < 400


@pytest.mark.parametrize(
    ("mapped", "told", "named"),
    [
        ("category\nstove\n", TOLD, f"{CATEGORIES}: line 1: expected the columns category, synset"),
        (MAPPED + "stove,oven.n.01\n", TOLD, f"{CATEGORIES}: line 6: 'stove' is listed twice"),
        (MAPPED.replace("stove.n.01", "stove"), TOLD, f"{SCENES}: House_0: kitchen_0: model 'stove-abcdef'"),
        (
            MAPPED,
            {k: v for k, v in TOLD.items() if k != "cabinet.n.03"},
            f"{SCENES}: House_0: kitchen_0: model 'locker-",
        ),
        (MAPPED, {**TOLD, "stove.n.01": ["heatSource"]}, f"{PROPERTIES}: 'stove.n.01'"),
    ],
)
def test_broken_tables_are_refused(tmp_path: Path, mapped: str, told: object, named: str) -> None:
    with pytest.raises(InputError) as refused:
        mined(folder_of(tmp_path, mapped=mapped, told=told))
    assert named in str(refused.value)


@pytest.mark.parametrize("file", [SCENES, CATEGORIES, PROPERTIES])
def test_a_file_that_is_missing_is_named(tmp_path: Path, file: str) -> None:
    folder = folder_of(tmp_path)
    (folder / file).unlink()
    with pytest.raises(InputError, match=f"{file}: expected.*No such file"):
        mined(folder)


@pytest.mark.parametrize(("file", "limit", "most"), [(SCENES, "MOST", "20 characters"), (CATEGORIES, "MOST_ROWS", "")])
def test_a_file_that_is_too_large_is_refused_before_it_is_held(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, file: str, limit: str, most: str
) -> None:
    folder = folder_of(tmp_path)
    monkeypatch.setattr(_rows, limit, 20 if most else 2)
    with pytest.raises(InputError, match=f"{file}: .*expected a .* of at most {most or '2 rows'}"):
        mined(folder)


def has_package() -> bool:
    try:
        return distribution("bddl").version == "3.6.0"
    except PackageNotFoundError:
        return False


@pytest.mark.skipif(not has_package(), reason="needs the package bddl 3.6.0")
def test_the_package_read_as_shipped_has_51_scenes_and_all_their_instances() -> None:
    shipped = read_params(ROOT / paths.BEYOND_PARAMS)["graphs"]["behavior"]["source"]
    how = {key: value for key, value in shipped.items() if key not in ("reader", "from")}
    assert (shipped["reader"], shipped["from"], set(how)) == ("behavior", "package", set(SETTINGS))
    mining = Mining(0)
    observations, kinds = mined("package", mining, **how)
    assert observations["scene"].nunique() == 51
    assert mining.left == dict(zip(STEPS, (36_164, 34_950), strict=True))
    assert observations.loc[observations["relation"] == "atLocation", "count"].sum() == 34_950
    assert kinds["kind"].value_counts().to_dict() == {"object": 522, "room": 39, "affordance": 25}
