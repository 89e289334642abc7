"""One rule for names: what files, bundles and homes accept, and spellings that are one name."""

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

import isi
from isi.errors import InputError
from isi.formats.plain import read
from isi.names import clean, name_fault, plain
from isi.vocabulary import Vocabulary
from tests.observing import observe, written
from tests.small_bundle import NAMES, home_of, small
from tests.small_bundle import written as write_bundle

NFC, NFD = "caf\u00e9 mug", "cafe\u0301 mug"
#: A word of Persian with a joiner, an emoji of three characters, private use, a name of 250
#: characters, a path.
VALID = ["می\u200cز", "👩\u200d🍳", "\ue000", "x" * 250, "../a/../b", "a  b"]


def test_triples_in_python_are_read_as_those_of_a_file() -> None:
    home = isi.train(
        [(NFC, "at", "b"), (NFD, "at", "c"), ("tea\u200b pot", "at", "b")],
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
def test_files_and_homes_hold_the_same_names(tmp_path: Path, name: str) -> None:
    with isi.open(home_of(tmp_path / "home", small(entity_names=[name, *NAMES[1:]]))) as home:
        assert home.base.entity_names[0] == name
    table = "head,relation,tail\n" + ",".join(f'"{part}"' for part in (name, "at", "b"))
    assert name in observe("table", written(tmp_path / "a.csv", table)).kind_of()


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
