"""Names, kinds and phrases of entities, which each source gives to what it has observed."""

from __future__ import annotations

import re
from collections.abc import Collection
from dataclasses import dataclass, field
from functools import cache
from typing import Annotated

import pandas as pd
from pydantic import AfterValidator, Field

from isi.config import Section
from isi.errors import InputError, short

#: Characters of a name, at most.
LONGEST = 200
#: Kind of an entity of which nothing says the kind.
ENTITY = "entity"
AT_LOCATION, HAS_MATERIAL, HAS_AFFORDANCE = "atLocation", "hasMaterial", "hasAffordance"
#: The kind of a relation's tails in a household; a location is a room where it bears a room's name, else an object.
_TAIL_KINDS = {AT_LOCATION: "object", HAS_MATERIAL: "material", HAS_AFFORDANCE: "affordance"}


def name_fault(name: object) -> str | None:
    """What is wrong with a name; null where nothing is."""
    if not isinstance(name, str) or not name:
        return "expected a name, got none"
    if len(name) > LONGEST:
        return f"expected a name of at most {LONGEST} characters, got {len(name):,}: {short(name)}"
    if not name.isprintable() or name != name.strip() or "../" in name:
        return f"expected a name without control characters, space around it or '../', got {short(name)}"
    return None


def check_name(name: str) -> str:
    """The name itself.

    Raises:
        ValueError: where it is none (``name_fault``).
    """
    if fault := name_fault(name):
        raise ValueError(fault)
    return name


#: Name of an entity, a relation, a scene: printable text of 1 to ``LONGEST`` characters.
Name = Annotated[str, AfterValidator(check_name)]


def check_names(names: pd.Series[str], path: object) -> None:
    """Check a column of names; its index, named ``line`` or ``row``, says where each of them stands in the file.

    Raises:
        InputError: for the first that is no name.
    """
    faults = {name: fault for name in names.unique() if (fault := name_fault(name))}
    if faults:
        place, name = next((place, name) for place, name in names.items() if name in faults)
        raise InputError(path, f"{names.index.name} {place}", f"{names.name}: {faults[name]}")


@cache
def entity_name(object_type: str) -> str:
    """Lower-case words of a type in camel case: ``TVStand`` → ``tv stand``."""
    return re.sub(r"(?<=[a-z])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])", " ", object_type).lower()


def phrase(name: str) -> str:
    """The words of a name, which are looked up in the word vectors: ``TVStand`` and ``tv_stand`` → ``tv stand``."""
    return " ".join(entity_name(name.replace("_", " ")).split()) or name


def household(triples: pd.DataFrame, rooms: Collection[str]) -> pd.DataFrame:
    """Entities of a household in alphabetical order, with kind and phrase (``tables.KINDS``).

    Args:
        triples: unique triples; columns head, relation, tail.
        rooms: names of rooms.

    Raises:
        InputError: where a relation is none of a household, or a name would be of two kinds.
    """
    others = triples.loc[~triples["relation"].isin(_TAIL_KINDS), "relation"]
    if len(others):
        raise InputError(f"relation {others.iloc[0]!r}", "", f"expected one of {', '.join(_TAIL_KINDS)}")
    is_room = (triples["relation"] == AT_LOCATION) & triples["tail"].isin(rooms)
    heads = pd.DataFrame({"entity": triples["head"], "kind": "object"})
    tail_kinds = triples["relation"].map(_TAIL_KINDS).mask(is_room, "room")
    tails = pd.DataFrame({"entity": triples["tail"], "kind": tail_kinds})
    entities = pd.concat([heads, tails]).drop_duplicates().sort_values(["entity", "kind"])
    repeated = entities[entities["entity"].duplicated(keep=False)]
    if len(repeated):
        name = repeated["entity"].iloc[0]
        kinds = " and ".join(repeated.loc[repeated["entity"] == name, "kind"])
        raise InputError(f"entity {name!r}", "", f"expected one kind, got {kinds}")
    return entities.assign(phrase=entities["entity"]).reset_index(drop=True)


class Ends(Section):
    """The kinds of a relation's heads and tails."""

    head: Name
    tail: Name


#: By relation.
KindsByRelation = Annotated[dict[str, Ends], Field(min_length=1)]


@dataclass
class Naming:
    """Names the entities of triples: the kind of each by its name, else by its relations, else ``ENTITY``."""

    kinds: KindsByRelation | None = None
    #: whether relations and kinds are those of a household
    household: bool = False
    #: of entities that a table or the file itself describes
    kind_of: dict[str, str] = field(default_factory=dict)
    phrase_of: dict[str, str] = field(default_factory=dict)
    #: whether every entity must be given a kind
    strict: bool = False

    def __call__(self, triples: pd.DataFrame, rooms: Collection[str]) -> pd.DataFrame:
        """Entities of the triples in alphabetical order, with kind and phrase (``tables.KINDS``).

        Raises:
            InputError: where an entity has no kind, or its relations give it two.
        """
        by_household = household(triples, rooms) if self.household else pd.DataFrame(columns=["entity", "kind"])
        kinds = dict(zip(by_household["entity"], by_household["kind"], strict=True))
        kinds |= self._by_relation(triples) | self.kind_of
        names = sorted({*triples["head"], *triples["tail"]})
        without = next((name for name in names if name not in kinds), None)
        if without is not None and self.strict:
            raise InputError(f"entity {without!r}", "", "expected its kind, from the table of entities or by relation")
        phrases = [self.phrase_of.get(name) or phrase(name) for name in names]
        return pd.DataFrame({"entity": names, "kind": [kinds.get(name, ENTITY) for name in names], "phrase": phrases})

    def _by_relation(self, triples: pd.DataFrame) -> dict[str, str]:
        unknown = set(self.kinds or ()) - set(triples["relation"])
        if unknown:
            raise InputError("kinds", f"relation {min(unknown)!r}", "no triple has it")
        kind_and_place: dict[str, tuple[str, str]] = {}
        for relation, ends in (self.kinds or {}).items():
            of_relation = triples[triples["relation"] == relation]
            for slot, kind in (("head", ends.head), ("tail", ends.tail)):
                place = f"{slot} of {relation}"
                for name in sorted(set(of_relation[slot]) - set(self.kind_of)):
                    other, other_place = kind_and_place.setdefault(name, (kind, place))
                    if other != kind:
                        expected = f"expected one kind, got {other} ({other_place}) and {kind} ({place})"
                        raise InputError(f"entity {name!r}", "", expected)
        return {name: kind for name, (kind, _) in kind_and_place.items()}
