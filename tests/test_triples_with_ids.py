"""Triples as ids: hand-made files, bad ones, and the two graphs that ship."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st

from isi.errors import InputError
from isi.sources.triples_with_ids import KINDS, read_ids, shipped_names
from tests.observing import observations_of

FILES = {
    "entity2id.txt": "4\nalarmclock.o\t0\ndesk.l\t2\nwall_lamp.o\t1\ntown hall\t3\n",
    "relation2id.txt": "2\nObjOnLoc\t0\nknows\t1\n",
    "gt2id.txt": "4\n0 2 0\n1,2,0\n0\t2\t0\r\n3 0 1\n",
}


def folder_of(path: Path, **changes: str | None) -> Path:
    """A folder of the files, some of them changed or missing."""
    for name, content in {**FILES, **{f"{key}.txt": content for key, content in changes.items()}}.items():
        if content is not None:
            (path / name).write_bytes(content.encode("utf-8", "surrogateescape"))
    return path


def mined(from_: str, triples: list[str] | None = None) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Observations, and kinds."""
    found = observations_of({"reader": "triples_with_ids", "from": from_, "triples": triples})
    return found.table, found.kinds


def test_ids_are_head_tail_and_relation_and_repeats_are_observations(tmp_path: Path) -> None:
    observations, kinds = mined(str(folder_of(tmp_path)))
    assert observations[["scene", "room", "instance"]].isna().all(axis=None)
    assert observations[["head", "relation", "tail", "count"]].to_numpy().tolist() == [
        ["alarmclock.o", "ObjOnLoc", "desk.l", 2],
        ["town hall", "knows", "alarmclock.o", 1],
        ["wall_lamp.o", "ObjOnLoc", "desk.l", 1],
    ]
    assert kinds.to_numpy().tolist() == [
        ["alarmclock.o", "object", "alarmclock"],
        ["desk.l", "location", "desk"],
        ["town hall", "entity", "town hall"],
        ["wall_lamp.o", "object", "wall lamp"],
    ]


def test_names_of_the_graphs_that_ship_say_nothing_of_a_folder(tmp_path: Path) -> None:
    names, triples = "3\nbowl.o\t0\nbowl\t1\nalarm clock\t2\n", "2\n0 1 1\n2 0 0\n"
    observations, kinds = mined(str(folder_of(tmp_path, entity2id=names, gt2id=triples)))
    assert observations[["head", "tail"]].to_numpy().tolist() == [["alarm clock", "bowl.o"], ["bowl.o", "bowl"]]
    assert kinds.to_numpy().tolist() == [
        ["alarm clock", "entity", "alarm clock"], ["bowl", "entity", "bowl"], ["bowl.o", "object", "bowl"],
    ]  # fmt: skip


def test_several_files_of_triples_are_one_graph(tmp_path: Path) -> None:
    folder = folder_of(tmp_path, train2id="1\n0 2 0\n", test2id="2\n0 2 0\n1 2 0\n")
    observations, _ = mined(str(folder), ["train2id.txt", "test2id.txt"])
    assert observations["count"].tolist() == [2, 1]


@given(st.lists(st.tuples(st.integers(0, 3), st.integers(0, 3), st.integers(0, 1)), min_size=1, max_size=30))
def test_every_line_is_counted_once(tmp_path_factory: pytest.TempPathFactory, rows: list[tuple[int, int, int]]) -> None:
    lines = [f"{len(rows)}", *(f"{head} {tail} {relation}" for head, tail, relation in rows), ""]
    folder = folder_of(tmp_path_factory.mktemp("ids"), gt2id="\n".join(lines))
    names, relations = ["alarmclock.o", "wall_lamp.o", "desk.l", "town hall"], ["ObjOnLoc", "knows"]
    expected = Counter((names[head], relations[relation], names[tail]) for head, tail, relation in rows)
    assert read_ids(folder, ["gt2id.txt"]) == expected


@pytest.mark.parametrize(
    ("file", "content", "place"),
    [
        ("gt2id", None, "expected a text file"),
        ("gt2id", "", "line 1"),
        ("gt2id", FILES["gt2id.txt"][:-6], "line 1: expected how many lines follow, which are 3"),
        ("gt2id", "1\n0 2\n", "line 2: expected three ids"),
        ("gt2id", "1\n0 2 -1\n", "line 2: expected three ids"),
        ("gt2id", "1\n0 4 0\n", "line 2: expected ids of 4 entities"),
        ("gt2id", "1\n0 2 2\n", "line 2: expected ids of 4 entities and 2 relations"),
        ("gt2id", "\udcff\udcfe1\n", "expected a text file"),
        ("entity2id", "1\nalarmclock.o 0\n", "line 2: expected a name, a tab and an id"),
        ("entity2id", "2\na.o\t0\nb.o\t0\n", "line 3"),
        ("entity2id", "2\na.o\t0\na.o\t1\n", "line 3"),
        ("entity2id", "2\na.o\t0\nb.o\t2\n", "expected the ids from 0 to 1"),
        ("entity2id", "1\na\u001b[0m.o\t0\n", "line 2"),
        ("entity2id", "1\n mug.o\t0\n", "line 2: expected a name without"),
        ("relation2id", "1\nis/../in\t0\n", "line 2: expected a name without"),
    ],
)
def test_a_broken_file_is_refused_in_one_short_line(tmp_path: Path, file: str, content: str | None, place: str) -> None:
    folder = folder_of(tmp_path)
    (folder / f"{file}.txt").unlink()
    with pytest.raises(InputError) as refused:
        mined(str(folder_of(tmp_path, **{file: content})))
    line = str(refused.value)
    assert line.startswith(f"{folder / file}.txt: ")
    assert place in line
    assert line.isprintable()
    assert len(line) < 400


def test_a_folder_without_triples_is_refused(tmp_path: Path) -> None:
    folder = folder_of(tmp_path, gt2id="0\n", more2id="0")
    with pytest.raises(InputError, match=r"gt2id\.txt, more2id\.txt: expected triples, got none"):
        mined(str(folder), ["gt2id.txt", "more2id.txt"])


@pytest.mark.parametrize(
    ("name", "triples", "observed", "relations", "kinds"),
    [
        ("virtualhome", 4_240, 350_895, 11, {"object": 182, "location": 40, "action": 34, "state": 16, "room": 4}),
        ("thor_u", 1_964, 1_964, 15,
         {"object": 113, "location": 39, "action": 27, "state": 14, "material": 13, "room": 4}),
    ],
)  # fmt: skip
def test_a_graph_that_ships_is_that_of_its_authors(
    name: str, triples: int, observed: int, relations: int, kinds: dict[str, int]
) -> None:
    observations, of_kinds = mined(name)
    assert len(observations) == triples
    assert observations["count"].sum() == observed
    assert observations["relation"].nunique() == relations
    assert of_kinds["kind"].value_counts().to_dict() == kinds


def test_rooms_and_locations_are_where_their_relations_lead() -> None:
    observations, kinds = mined("thor_u")
    kind = dict(zip(kinds["entity"], kinds["kind"], strict=True))
    for relation, head, tail in (("ObjInRoom", "object", "room"), ("LocInRoom", "location", "room"),
                                 ("ObjOnLoc", "object", "location"), ("HasMat", "object", "material"),
                                 ("HasEffect", "action", "state")):  # fmt: skip
        ends = observations[observations["relation"] == relation]
        assert set(ends["head"].map(kind)) == {head}
        assert set(ends["tail"].map(kind)) == {tail}


def test_names_of_the_graphs_agree_and_tell_entities_apart() -> None:
    names = shipped_names()
    assert not names["name"].duplicated().any()
    of_kind = names.assign(kind=names["name"].str.rpartition(".")[2].map(KINDS))
    told = of_kind[["entity", "phrase", "kind"]].drop_duplicates()
    assert not told["entity"].duplicated().any()
    assert (told["entity"].str.replace(r" \((place|action|state|material)\)$", "", regex=True) == told["phrase"]).all()
