"""Timelines: ids in the order of first appearance, the ten benchmarks, folders of LKGE's form."""

import hashlib
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given

from isi.continual import BENCHMARKS, Timeline
from isi.continual.timeline import SPLITS
from isi.errors import InputError
from tests.small_timelines import timelines

#: By benchmark, entities and relations after each snapshot, and its triples in train, valid and
#: test, as published (HYBRID's entities: those of all three files; FBinc-L's relations: counted).
COUNTS = {
    "ENTITY": """
        2909 233 27832/9278/9278 | 5817 236 43265/14423/14423 | 8725 236 44269/14758/14758
        | 11633 237 42302/14102/14102 | 14541 237 28394/9466/9466""",
    "RELATION": """
        11561 49 59291/19764/19764 | 13344 96 56119/18708/18708 | 13755 143 39680/13228/13228
        | 14387 190 18018/6007/6007 | 14541 237 12956/4319/4319""",
    "FACT": """
        10513 237 37214/12405/12405 | 12779 237 37213/12405/12405 | 13586 237 37213/12405/12405
        | 13894 237 37213/12405/12405 | 14541 237 37213/12405/12405""",
    "HYBRID": """
        8631 86 34535/11513/11513 | 10043 102 12523/4175/4175 | 12780 151 52809/17604/17604
        | 14395 209 62003/20668/20668 | 14541 237 24194/8066/8066""",
    "GraphEqual": """
        2908 226 34581/11527/11528 | 5816 235 37213/12404/12406 | 8724 237 37213/12404/12406
        | 11632 237 37213/12404/12406 | 14541 237 39846/13282/13283""",
    "GraphHigher": """
        900 197 6000/2000/2000 | 1838 221 12000/4000/4000 | 3714 234 24000/8000/8000
        | 7467 237 48000/16000/16000 | 14541 237 96069/32023/32024""",
    "GraphLower": """
        7505 237 96000/32000/32000 | 11258 237 48000/16000/16000 | 13134 237 24000/8000/8000
        | 14072 237 12000/4000/4000 | 14541 237 6069/2023/2024""",
    "FBinc-S": """
        2909 233 27832/9278/9278 | 2919 233 148/40/47 | 2930 233 85/28/39
        | 2940 233 105/32/43 | 2950 233 138/44/57""",
    "FBinc-M": """
        2909 233 27832/9278/9278 | 2959 233 530/165/206 | 3009 233 971/320/315
        | 3059 233 955/294/340 | 3109 233 870/282/267""",
    "FBinc-L": """
        2909 233 27832/9278/9278 | 3010 233 1895/606/609 | 3110 234 1630/528/578
        | 3211 234 1781/562/565 | 3312 234 1899/590/616""",
}
#: ``digest`` of each benchmark: whoever compares results needs its triples to stay.
DIGESTS = {
    "ENTITY": "1207961b18cbdf44f6756e8e783722870dea21e4bf562cf0b070f68cf764b9ab",
    "RELATION": "b32fd3ac628882a24138fcba4d7a6c0a98c0f06e56010a2879b2012f0d492a30",
    "FACT": "bb7b799040034e23144bb3450db96901caf679df049452ff917c42bab6f337d2",
    "HYBRID": "39233c3dbb15b1d32b19a7d61cb0f32dbe811e5942ff884933fdac6b61fdd33f",
    "GraphEqual": "57297b1c4ac60f04f1d7b6c364b1c701098b22f603897246815acece6cec87b5",
    "GraphHigher": "80100002d1367c14d95b95baf872f6bb881e32eaf7ceb4c523ab24fe2476b979",
    "GraphLower": "19ec728b6c12432839434c2453661ef060426c1261a3a5f1bd6432246f1cd39b",
    "FBinc-S": "69b46c13bf70699829d9fb949a117e8b402fcc22516320286161be9d569c0c9e",
    "FBinc-M": "8c5b34f217b24ef7551a6a0bab84b6f0bfd3ea039bfb708c58788abed103f0ff",
    "FBinc-L": "353219259f529f83ed50dde9be6a25f0809bab284071b46280b802bc28443f04",
}
HOME = [("cup", "in", "kitchen"), ("bed", "in", "bedroom")]


@cache
def benchmark(name: str) -> Timeline:
    return Timeline.benchmark(name)


def digest(timeline: Timeline) -> str:
    """Of all names in alphabetical order, and of the triples of each file in these numbers."""
    done = hashlib.sha256()
    places = []
    for names in (timeline.entity_names, timeline.relation_names):
        order = sorted(range(len(names)), key=names.__getitem__)
        done.update("\n".join(names[number] for number in order).encode())
        places.append(np.argsort(order))
    for snapshot in timeline.snapshots:
        for split in SPLITS:
            head, relation, tail = snapshot.split(split).T
            rows = np.stack([places[0][head], places[1][relation], places[0][tail]], 1)
            done.update(rows[np.lexsort(rows.T[::-1])].astype("<i8").tobytes())
    return done.hexdigest()


# The benchmarks


@pytest.mark.parametrize("name", BENCHMARKS)
def test_a_benchmark_has_the_published_counts(name: str) -> None:
    table = benchmark(name).table()
    columns = ["entities", "relations", *SPLITS]
    expected = [list(map(int, part.replace("/", " ").split())) for part in COUNTS[name].split("|")]
    assert table[columns].to_numpy().tolist() == expected
    assert table["new_entities"].sum() == table["entities"].iloc[-1]


@pytest.mark.parametrize("name", BENCHMARKS)
def test_a_benchmark_has_the_same_triples_in_all_versions(name: str) -> None:
    assert digest(benchmark(name)) == DIGESTS[name]


def test_entities_of_a_benchmark_have_names_and_words() -> None:
    timeline = benchmark("ENTITY")
    place = timeline.entity_names.index("/m/0102t4")
    assert timeline.words[place] == "Marshall"
    assert timeline.relation_names[0].startswith("/")


def test_another_name_is_refused_with_the_nearest_one() -> None:
    with pytest.raises(InputError, match=r"expected one of ENTITY.*did you mean 'FBinc-S'"):
        Timeline.benchmark("fbinc_s")


# Ids


def test_ids_follow_the_first_appearance_in_train_then_valid_then_test() -> None:
    later = [("mug", "like", "cup")], [("pan", "like", "pot")], [("lid", "in", "cup")]
    timeline = Timeline.of([(HOME, [], []), later])
    assert timeline.entity_names[4:] == ["mug", "pan", "pot", "lid"]
    assert timeline.snapshots[1].valid.tolist() == [[5, 1, 6]]
    assert (timeline.entities.tolist(), timeline.relations.tolist()) == ([4, 8], [1, 2])


@given(timelines())
def test_after_a_snapshot_the_first_ids_are_those_that_have_appeared(timeline: Timeline) -> None:
    seen, used = set[int](), set[int]()
    for number, snapshot in enumerate(timeline.snapshots):
        seen |= {*snapshot.triples[:, [0, 2]].ravel().tolist()}
        used |= {*snapshot.triples[:, 1].tolist()}
        assert seen == set(range(timeline.entities[number]))
        assert used == set(range(timeline.relations[number]))


# Folders


def write(folder: Path, snapshot: int | str, **texts: str) -> None:
    (folder / str(snapshot)).mkdir(parents=True, exist_ok=True)
    for split in SPLITS:
        text = texts.get(split, "")
        (folder / str(snapshot) / f"{split}.txt").write_text(text, encoding="utf-8")


def test_a_folder_is_the_timeline_of_its_files(tmp_path: Path) -> None:
    write(tmp_path, 0, train="cup\tin\tkitchen\nbed\tin\tbedroom\n", test='"pot"\tin\tkitchen\n')
    write(tmp_path, 1, valid="mug\tlike\tcup\n")
    (tmp_path / "README").touch()
    timeline = Timeline.from_folder(tmp_path)
    expected = Timeline.of(
        [(HOME, [], [('"pot"', "in", "kitchen")]), ([], [("mug", "like", "cup")], [])]
    )
    assert timeline.entity_names == expected.entity_names == timeline.words
    for snapshot, other in zip(timeline.snapshots, expected.snapshots, strict=True):
        for split in SPLITS:
            assert np.array_equal(snapshot.split(split), other.split(split))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("a\tb\tc\na\tb\n", "line 2: .*expected 3 columns, got 2"),
        ("a b c\n", "line 1: expected the columns head, relation, tail"),
        ("a\tb\tc\n\tb\tc\n", "line 2: head: expected a name"),
    ],
)
def test_a_wrong_line_is_named(tmp_path: Path, text: str, message: str) -> None:
    write(tmp_path, 0, train="cup\tin\tkitchen\n", valid=text)
    with pytest.raises(InputError, match=message) as caught:
        Timeline.from_folder(tmp_path)
    assert caught.value.file == str(tmp_path / "0" / "valid.txt")


def test_missing_files_and_folders_are_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"expected the folders 0, 1, ... of snapshots, got none"):
        Timeline.from_folder(tmp_path)
    write(tmp_path, 0, train="cup\tin\tkitchen\n")
    (tmp_path / "0" / "test.txt").unlink()
    with pytest.raises(InputError, match=r"test.txt: no such file"):
        Timeline.from_folder(tmp_path)
    write(tmp_path, 0, train="cup\tin\tkitchen\n")
    write(tmp_path, 2)
    with pytest.raises(InputError, match=r"folder 1: expected the folders 0, 1, .*got 0, 2"):
        Timeline.from_folder(tmp_path)


@pytest.mark.parametrize(
    ("snapshots", "message"),
    [
        ([], "argument 'snapshots'"),
        (3, "argument 'snapshots'"),
        ([(HOME, [], []), (HOME, [])], "snapshot 1: .*2 parts"),
        ([(HOME, [], []), ([], [], [("cup", "in")])], "snapshot 1: test, triple 0"),
        ([([*HOME, ("cup", "in", "hall", 3)], [], [])], "snapshot 0: train, triple 2"),
        ([(["cup"], [], [])], "snapshot 0: train, triple 0"),
        ([([{"cup", "in", "hall"}], [], [])], "snapshot 0: train, triple 0"),
        ([(HOME, [("cup", None, "hall")], [])], "snapshot 0: valid, triple 0: relation"),
        ([(HOME, [], [("cup", "in", float("nan"))])], "snapshot 0: test, triple 0: tail"),
        ([(HOME, [], [(" ", "in", "hall")])], "snapshot 0: test, triple 0: head"),
    ],
)
def test_wrong_parts_are_named_by_snapshot_split_and_triple(snapshots: Any, message: str) -> None:
    with pytest.raises(InputError, match=message):
        Timeline.of(snapshots)


def test_a_number_is_the_name_of_its_digits() -> None:
    assert Timeline.of([([("7", "in", 7), (np.int64(7), "in", "8")], [], [])]).entity_names == [
        "7",
        "8",
    ]
