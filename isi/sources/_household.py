"""What homes are told in: three relations, and four kinds of entities."""

from __future__ import annotations

import re
from collections.abc import Collection
from functools import cache

import pandas as pd

from isi.errors import InputError

AT_LOCATION, HAS_MATERIAL, HAS_AFFORDANCE = "atLocation", "hasMaterial", "hasAffordance"
#: What the tail of a relation is; locations are rooms where they bear a room's name, else objects.
_TAILS = {AT_LOCATION: "object", HAS_MATERIAL: "material", HAS_AFFORDANCE: "affordance"}


@cache
def entity_name(object_type: str) -> str:
    """Lower-case words of a type in camel case: ``TVStand`` → ``tv stand``."""
    return re.sub(r"(?<=[a-z])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])", " ", object_type).lower()


def household(triples: pd.DataFrame, rooms: Collection[str]) -> pd.DataFrame:
    """Entities of the triples in alphabetical order, with their kind and their name as phrase (``tables.KINDS``).

    Args:
        triples: unique ones; columns head, relation, tail.
        rooms: names of rooms.

    Raises:
        InputError: where a relation is none of the three, or a name would be of two kinds.
    """
    others = triples.loc[~triples["relation"].isin(_TAILS), "relation"]
    if len(others):
        raise InputError(f"relation {others.iloc[0]!r}", "", f"expected one of {', '.join(_TAILS)}")
    is_room = (triples["relation"] == AT_LOCATION) & triples["tail"].isin(rooms)
    heads = pd.DataFrame({"entity": triples["head"], "kind": "object"})
    tails = pd.DataFrame({"entity": triples["tail"], "kind": triples["relation"].map(_TAILS).mask(is_room, "room")})
    unique = pd.concat([heads, tails]).drop_duplicates().sort_values(["entity", "kind"])
    twice = unique[unique["entity"].duplicated(keep=False)]
    if len(twice):
        name = twice["entity"].iloc[0]
        of = " and ".join(twice.loc[twice["entity"] == name, "kind"])
        raise InputError(f"entity {name!r}", "", f"expected one kind, got {of}")
    return unique.assign(phrase=unique["entity"]).reset_index(drop=True)
