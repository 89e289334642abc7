"""Names, kinds and phrases of the entities of a source."""

import re
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field
from functools import cache
from typing import Annotated

import pandas as pd
from pydantic import AfterValidator, Field

from isi.config import Section
from isi.errors import InputError, short

LONGEST = 200  #: Maximum number of characters of a name.
ENTITY = "entity"  #: The kind of an entity without a given kind.
AT_LOCATION, HAS_MATERIAL, HAS_AFFORDANCE = "atLocation", "hasMaterial", "hasAffordance"


def name_fault(name: object) -> str | None:
    """The message of the error for an invalid name; null for a valid one."""
    if not isinstance(name, str) or not name:
        return f"expected a name, got {short(name) if name else 'none'}"
    if len(name) > LONGEST:
        return f"expected a name of at most {LONGEST} characters, got {len(name):,}: {short(name)}"
    if not name.isprintable() or name != name.strip() or "../" in name:
        return f"expected a name without control characters, space around it or '../', got {short(name)}"
    return None


def check_name(name: str) -> str:
    """Return a valid name; ValueError for any other (``name_fault``)."""
    if fault := name_fault(name):
        raise ValueError(fault)
    return name


#: The name of an entity, a relation, a scene or an object is printable text of 1 to ``LONGEST`` characters.
Name = Annotated[str, AfterValidator(check_name)]


@cache
def entity_name(object_type: str) -> str:
    """Lower-case words of a type in camel case: ``TVStand`` → ``tv stand``."""
    return re.sub(r"(?<=[a-z])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])", " ", object_type).lower()


def phrase(name: str) -> str:
    """The words of a name, for its word vector: ``TVStand`` and ``tv_stand`` → ``tv stand``."""
    return " ".join(entity_name(name.replace("_", " ")).split()) or name


class Ends(Section):
    """The kinds of a relation's heads and tails."""

    head: Name
    tail: Name


KindsByRelation = Annotated[dict[str, Ends], Field(min_length=1)]
#: Kinds by relation of a household; the tail of ``atLocation`` has the kind room if it is the name of a room.
HOUSEHOLD = {
    relation: Ends(head="object", tail=tail)
    for relation, tail in ((AT_LOCATION, "object"), (HAS_MATERIAL, "material"), (HAS_AFFORDANCE, "affordance"))
}


@dataclass
class Naming:
    """Assign each entity a phrase, and a kind: from ``kind_of``, else from its relations, else ``ENTITY``."""

    kinds: KindsByRelation | None = None
    household: bool = False  #: use ``HOUSEHOLD`` for ``kinds``, refuse other relations
    kind_of: dict[str, str] = field(default_factory=dict)  #: by entity, from a table or the file itself
    phrase_of: dict[str, str] = field(default_factory=dict)  #: as ``kind_of``
    strict: bool = False  #: whether an entity without a kind is refused
    words: Callable[[str], str] = phrase  #: gives the phrase of an entity that is not in ``phrase_of``

    def __call__(self, triples: pd.DataFrame, rooms: Collection[str]) -> pd.DataFrame:
        """Entities (``KINDS``) of unique triples, sorted; InputError for an unknown relation, two kinds or none."""
        relations = set(triples["relation"])
        if unknown := set(self.kinds or ()) - relations:
            raise InputError("kinds", f"relation {min(unknown)!r}", "expected a relation of the triples")
        if self.household and (unknown := relations - set(HOUSEHOLD)):
            raise InputError(f"relation {min(unknown)!r}", "", f"expected one of {', '.join(HOUSEHOLD)}")
        kinds = self._by_relation(triples, rooms) | self.kind_of
        names = sorted({*triples["head"], *triples["tail"]})
        without = next((name for name in names if name not in kinds), None)
        if without is not None and self.strict:
            raise InputError(f"entity {without!r}", "", "expected a kind in the table of entities or the setting kinds")
        phrases = [self.phrase_of.get(name) or self.words(name) for name in names]
        return pd.DataFrame({"entity": names, "kind": [kinds.get(name, ENTITY) for name in names], "phrase": phrases})

    def _by_relation(self, triples: pd.DataFrame, rooms: Collection[str]) -> dict[str, str]:
        """Kind by entity, from relations; InputError for two. Skips entities in ``kind_of`` unless ``household``."""
        ends: Mapping[str, Ends] = HOUSEHOLD if self.household else self.kinds or {}
        described = () if self.household else self.kind_of
        slots = {
            (relation, slot, name)
            for slot in ("head", "tail")
            for relation, name in zip(triples["relation"], triples[slot], strict=True)
            if relation in ends and name not in described
        }
        kind_and_place: dict[str, tuple[str, str]] = {}
        for relation, slot, name in sorted(slots):
            is_room = self.household and (relation, slot) == (AT_LOCATION, "tail") and name in rooms
            kind, place = "room" if is_room else getattr(ends[relation], slot), f"{slot} of {relation}"
            other, other_place = kind_and_place.setdefault(name, (kind, place))
            if other != kind:
                expected = f"expected one kind, got {other} ({other_place}) and {kind} ({place})"
                raise InputError(f"entity {name!r}", "", expected)
        return {name: kind for name, (kind, _) in kind_and_place.items()}


household = Naming(household=True, words=str)  #: In a household, the phrase of an entity is its name.
