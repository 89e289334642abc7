"""Sources as data: registered in one place, set from their signatures, and named when they end."""

from __future__ import annotations

from collections.abc import Iterator

import pandas as pd
import pyarrow as pa
import pytest

from isi.config import Count, read
from isi.errors import InputError
from isi.sources import SOURCES, Mining, Observed, part, settings_of, source
from isi.sources._household import household
from isi.tables import paths

MP3D = read(paths.PARAMS)["sources"]["mp3d"]
HOUSES = {**MP3D, "reader": "mp3d_houses", "folder": "houses", "category": "mpcat40", "rooms": {"k": "kitchen"}}


def of_kind(triples: pd.DataFrame, rooms: set[str]) -> pd.DataFrame:
    """Entities of a kind that no home has."""
    assert rooms == {"sea"}
    names = sorted({*triples["head"], *triples["tail"]})
    return pd.DataFrame({"entity": names, "kind": "animal", "phrase": names})


@source("pretended", entities=of_kind)
def pretended(mining: Mining, fish: Count, name: str = "cod") -> Iterator[pa.Table]:
    """As many fish as it is set to."""
    for number in range(fish):
        mining.left["fish"] += 1
        yield part([("scene", "sea", str(number), name, "eats", "crab", 1)])


def named(*triples: tuple[str, str, str]) -> pd.DataFrame:
    return household(pd.DataFrame(triples, columns=["head", "relation", "tail"]), {"kitchen", "bedroom"})


def test_the_sources_are_the_modules_that_register_one() -> None:
    shipped = {
        "ai2thor", "ai2thor_scene", "behavior", "mp3d_houses", "mp3d_tallies", "procthor_houses", "published", "rdf",
        "robothor", "table", "triples_with_ids",
    }  # fmt: skip
    assert set(SOURCES.names()) == shipped | {"pretended"}
    for name in shipped:
        SOURCES.get(name, "sources.x.reader")


@pytest.mark.parametrize("name", read(paths.PARAMS)["sources"])
def test_the_settings_of_params_are_those_of_their_sources(name: str) -> None:
    settings_of(read(paths.PARAMS)["sources"][name], f"sources.{name}")


def test_a_source_observes_with_its_settings_and_tells_what_it_left() -> None:
    found, settings = settings_of({"reader": "pretended", "fish": 3}, "sources.mine")
    mining, observed = Mining(0), Observed(found.entities)
    observations = pa.concat_tables(observed.passing(found.observe(mining, **settings))).to_pandas()
    assert list(observations["head"]) == ["cod"] * 3
    assert observed.kinds.to_numpy().tolist() == [["cod", "animal", "cod"], ["crab", "animal", "crab"]]
    assert mining.left == {"fish": 3}


@pytest.mark.parametrize(
    ("values", "key"),
    [
        (None, ".*dictionary"),
        ({"reader": "whales"}, "reader: expected one of .*pretended.*'whales'"),
        ({"fish": 3}, "reader: "),
        ({"reader": "pretended"}, "fish: "),
        ({"reader": "pretended", "fish": 0}, "fish: "),
        ({"reader": "pretended", "fish": "many"}, "fish: "),
        ({"reader": "pretended", "fish": 3, "boat": "big"}, "boat: "),
        ({**MP3D, "rooms": {}}, "rooms: "),
        ({**MP3D, "vocabulary": {"structure": []}}, "vocabulary: "),
        ({**MP3D, "structure": ["wall"]}, "structure: "),
        ({**HOUSES, "category": "nyu40"}, "category: "),
        ({**HOUSES, "rooms": {"q": "kitchen"}}, "rooms"),
        ({key: value for key, value in HOUSES.items() if key != "folder"}, "folder: "),
    ],
)
def test_settings_that_a_source_does_not_take_are_refused_by_their_key(values: object, key: str) -> None:
    with pytest.raises(InputError, match=rf"^params\.yaml: sources\.mine[.:]{key}"):
        settings_of(values, "sources.mine")


def test_a_part_has_the_columns_of_observations_though_it_has_no_rows() -> None:
    assert part([]).schema.equals(part([(None, None, None, "mug", "atLocation", "kitchen", 1)]).schema)


@pytest.mark.parametrize(
    ("kinds", "name"), [(["cod"], "crab"), (["cod", "crab", "cod"], "cod")], ids=["none of it", "two of it"]
)
def test_a_source_must_give_each_entity_one_kind_and_before_its_observations_are_whole(
    kinds: list[str], name: str
) -> None:
    observed = Observed(lambda _triples, _rooms: pd.DataFrame({"entity": kinds, "kind": "animal", "phrase": kinds}))
    parts = observed.passing(pretended(Mining(0), fish=2))
    assert next(parts).num_rows == next(parts).num_rows == 1
    with pytest.raises(InputError, match=f"entity '{name}'"):
        next(parts)


# Homes


def test_entities_of_a_home_are_in_alphabetical_order_with_their_kind_and_one_row_a_name() -> None:
    entities = named(
        ("mug", "hasMaterial", "wood"), ("mug", "atLocation", "kitchen"), ("mug", "hasAffordance", "fill"),
        ("mug", "atLocation", "cabinet"), ("cabinet", "atLocation", "kitchen"),
    )  # fmt: skip
    assert list(entities[["entity", "kind", "phrase"]].itertuples(index=False, name=None)) == [
        ("cabinet", "object", "cabinet"),  # both a head and a location
        ("fill", "affordance", "fill"),
        ("kitchen", "room", "kitchen"),
        ("mug", "object", "mug"),
        ("wood", "material", "wood"),
    ]


@pytest.mark.parametrize(
    ("triples", "name", "kinds"),
    [
        ([("mug", "hasMaterial", "glass"), ("glass", "atLocation", "kitchen")], "glass", "material and object"),
        ([("mug", "hasMaterial", "dirty"), ("mug", "hasAffordance", "dirty")], "dirty", "affordance and material"),
        ([("mug", "atLocation", "kitchen"), ("kitchen", "hasMaterial", "wood")], "kitchen", "object and room"),
        ([("mug", "atLocation", "kitchen"), ("mug", "hasMaterial", "kitchen")], "kitchen", "material and room"),
    ],
)
def test_an_entity_of_two_kinds_is_refused(triples: list[tuple[str, str, str]], name: str, kinds: str) -> None:
    with pytest.raises(InputError, match=f"'{name}'.*{kinds}"):
        named(*triples)


def test_a_relation_that_homes_are_not_told_in_is_refused() -> None:
    with pytest.raises(InputError, match=r"relation 'eats'.*atLocation"):
        named(("mug", "atLocation", "kitchen"), ("cat", "eats", "fish"))
