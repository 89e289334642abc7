"""One rule for names: what files, bundles and exports accept, and spellings that are one name."""

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

import isi
from isi.__main__ import main
from isi.errors import InputError
from isi.graph.vocabulary import Vocabulary
from isi.live.bundle import read
from isi.names import clean, name_fault, plain
from isi.sources import CHANGED
from tests.observing import TRIPLE, observe, refused, written
from tests.small_bundle import NAMES, home_of, opened, small
from tests.small_bundle import written as write_bundle

NFC, NFD = "caf\u00e9 mug", "cafe\u0301 mug"
#: Spellings that show the same as ``tea pot``.
INVISIBLE = [
    "tea pot\u200b",
    "tea\u00a0pot",
    "tea\ufeff pot",
    "tea\u2009pot ",
    "\u202atea p\u00adot\u202c",
]
#: A word of Persian with a joiner, an emoji of three characters, private use, a name of 250
#: characters, a path.
VALID = ["می\u200cز", "👩\u200d🍳", "\ue000", "x" * 250, "../a/../b", "a  b"]


@pytest.mark.parametrize("spelling", [NFD, *INVISIBLE])
def test_spellings_that_show_the_same_are_one_entity_of_a_table(
    tmp_path: Path, spelling: str
) -> None:
    name = NFC if spelling == NFD else "tea pot"
    rows = f"head,relation,tail\n{name},at,kitchen\n{spelling},at,kitchen\n"
    observed = observe("table", written(tmp_path / "a.csv", rows))
    assert set(observed.kinds["entity"]) == {name, "kitchen"}
    assert observed.rows(*TRIPLE) == [(name, "at", "kitchen")] * 2
    assert observed.counts[CHANGED] == 1


def test_spellings_are_one_entity_in_rooms_rdf_and_tables_of_entities(tmp_path: Path) -> None:
    home = f'{{"rooms": [{{"name": "cafe\u0301", "objects": ["{NFD}", "{NFC}"]}}]}}'
    of_home = observe("rooms", written(tmp_path / "home.json", home))
    assert of_home.kind_of() == {NFC: "object", "caf\u00e9": "room"}
    rdf = "".join(
        f"<urn:x:{name}> <urn:x:at> <urn:x:b> .\n" for name in ("cafe\u0301", "caf\u00e9")
    )
    of_rdf = observe("rdf", written(tmp_path / "a.nt", rdf))
    assert of_rdf.rows(*TRIPLE) == [("caf\u00e9", "at", "b")]
    assert of_rdf.counts[CHANGED] == 1
    table = written(tmp_path / "a.csv", f"head,relation,tail\n{NFC},at,b\n")
    listed = written(tmp_path / "e.csv", f"entity,kind\n{NFD},thing\nb,place\n")
    of_table = observe("table", table, entities=str(listed))
    assert of_table.kind_of() == {NFC: "thing", "b": "place"}


def test_an_entity_in_two_spellings_is_in_the_table_of_entities_twice(tmp_path: Path) -> None:
    table = written(tmp_path / "a.csv", f"head,relation,tail\n{NFC},at,b\n")
    listed = written(tmp_path / "e.csv", f"entity,kind\n{NFD},thing\n{NFC},place\nb,place\n")
    refused("table", table, ["e.csv", "line", "once"], entities=str(listed))


def test_triples_in_python_are_read_as_those_of_a_file() -> None:
    home = isi.train(
        [(NFC, "at", "b"), (NFD, "at", "c"), ("tea\u200b pot", "at", "b")],
        model="distmult",
        dimension=2,
    )
    assert set(home.base.entity_names) == {NFC, "b", "c", "tea pot"}


@pytest.mark.parametrize("known", [NFC, NFD])
@pytest.mark.parametrize(
    "asked", [NFC, NFD, f"{NFC}\u200b", "caf\u00e9\u00a0mug", " cafe\u0301 mug "]
)
def test_an_entity_is_found_in_any_form_of_its_name(known: str, asked: str) -> None:
    assert Vocabulary("entity", [known, "mug"]).find(asked) == known


def test_joiners_are_part_of_a_name() -> None:
    assert Vocabulary("entity", ["👩🍳", "میز"]).same("👩\u200d🍳") is None
    assert Vocabulary("entity", ["👩🍳", "میز"]).same("می\u200cز") is None


@pytest.mark.parametrize("name", VALID)
def test_what_a_bundle_holds_is_exported_and_read_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    monkeypatch.chdir(tmp_path)
    home_of(Path("home"), small(entity_names=[name, *NAMES[1:]]))
    for form in ("turtle", "graphml", "pykeen-tsv"):
        main(["export", "--home", "home", "--format", form, "--out", f"out/{form}"])
    main(["export", "--home", "home", "--format", "turtle", "--out", "home.ttl"])
    assert name in observe("rdf", Path("home.ttl")).kind_of()
    table = "head,relation,tail\n" + ",".join(f'"{part}"' for part in (name, "at", "b"))
    assert name in observe("table", written(tmp_path / "a.csv", table)).kind_of()


def test_graphml_refuses_what_xml_cannot_hold_and_other_formats_write_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    home_of(Path("home"), small(entity_names=["a\ufffe", *NAMES[1:]]))
    arguments = ["export", "--home", "home", "--out", "out", "--format"]
    with pytest.raises(SystemExit):
        main([*arguments, "graphml"])
    assert not Path("out").exists()
    main([*arguments, "turtle"])
    assert "%EF%BF%BE" in Path("out").read_text(encoding="utf-8")


@pytest.mark.parametrize(
    "name", ["", " ", "\u00a0", "\u200b", "a\tb", "a\u2028b", "a\x00", "x" * 1001]
)
def test_files_and_bundles_refuse_the_same_names(tmp_path: Path, name: str) -> None:
    assert name_fault(name)
    folder = write_bundle(tmp_path / "files", small(entity_names=[name, *NAMES[1:]]))
    with pytest.raises(InputError):
        read(folder)
    with pytest.raises(InputError):
        isi.train([(name, "at", "b")])


@given(st.text(max_size=9))
def test_a_clean_name_stays_as_it_is(name: str) -> None:
    assert clean(clean(name)) == clean(name)
    assert plain(clean(name)) == plain(name)


def test_a_bundle_of_nfd_names_is_asked_in_nfc() -> None:
    live = isi.LiveEmbedding(opened(entity_names=[NFD, *NAMES[1:]]))
    assert live.ask(None, "atLocation", NFC).query[2] == NFD
