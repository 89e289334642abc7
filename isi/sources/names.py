"""Names, kinds and phrases of the entities of a source."""

import re
from collections import Counter
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field
from functools import cache
from typing import Annotated

import pandas as pd
from pydantic import AfterValidator, Field

from isi.config import Section
from isi.errors import InputError
from isi.names import check_name, clean, first_of

UNMATCHED = "names in the table of entities that no triple has"  #: Description of a count.
ENTITY = "entity"  #: The kind of an entity without a given kind.
AT_LOCATION, HAS_MATERIAL, HAS_AFFORDANCE = "atLocation", "hasMaterial", "hasAffordance"


#: The name of an entity, a relation, a scene or an object.
Label = Annotated[str, AfterValidator(check_name)]


@cache
def entity_name(object_type: str) -> str:
    """Lower-case words of a type in camel case: ``TVStand`` → ``tv stand``."""
    return re.sub(r"(?<=[a-z])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])", " ", object_type).lower()


def phrase(name: str) -> str:
    """The words of a name, for its word vector: ``TVStand`` and ``tv_stand`` → ``tv stand``."""
    return " ".join(entity_name(name.replace("_", " ")).split()) or name


def words(name: str) -> str:
    """A name with its words parted if it has the form ``TVStand`` or ``tv_stand``;
    other names stay as they are.
    """
    is_joined = "_" in name or re.search("[a-z][A-Z]|[A-Z][A-Z][a-z]", name)
    return phrase(name) if is_joined else name


class Ends(Section):
    """The kinds of a relation's heads and tails."""

    head: Label
    tail: Label


KindsByRelation = Annotated[dict[str, Ends], Field(min_length=1)]
#: Kinds by relation of a household; the tail of ``atLocation`` has the kind room if it is the name
#: of a room.
HOUSEHOLD = {
    relation: Ends(head="object", tail=tail)
    for relation, tail in (
        (AT_LOCATION, "object"),
        (HAS_MATERIAL, "material"),
        (HAS_AFFORDANCE, "affordance"),
    )
}


@dataclass
class Naming:
    """Assign each entity a phrase, and a kind:
    from ``kind_of``, else from its relations, else ``ENTITY``.
    """

    kinds: KindsByRelation | None = None
    household: bool = False  #: use ``HOUSEHOLD`` for ``kinds``, refuse other relations
    #: by entity, from a table or the file itself
    kind_of: dict[str, str] = field(default_factory=dict)
    phrase_of: dict[str, str] = field(default_factory=dict)  #: as ``kind_of``
    strict: bool = False  #: whether an entity without a kind is refused
    #: gives the phrase of an entity that is not in ``phrase_of``
    words: Callable[[str], str] = phrase
    #: entities of a user's table; those that no triple has are counted in ``counts``
    of_table: Collection[str] = ()
    counts: Counter[str] = field(default_factory=Counter)

    def __call__(self, triples: pd.DataFrame, rooms: Collection[str]) -> pd.DataFrame:
        """Entities of unique triples, with kind and phrase, sorted;
        InputError for an unknown relation, two kinds or none.
        """
        relations = set(triples["relation"])
        if unknown := set(map(clean, self.kinds or ())) - relations:
            raise InputError(
                "kinds", f"relation {min(unknown)!r}", "expected a relation of the triples"
            )
        if self.household and (unknown := relations - set(HOUSEHOLD)):
            raise InputError(
                f"relation {min(unknown)!r}", "", f"expected one of {', '.join(HOUSEHOLD)}"
            )
        kind_of, phrase_of = _cleaned(self.kind_of), _cleaned(self.phrase_of)
        kinds = self._by_relation(triples, rooms, kind_of) | kind_of
        names = sorted({*triples["head"], *triples["tail"]})
        if self.of_table:
            self._count_unmatched(names)
        without = next((name for name in names if name not in kinds), None)
        if without is not None and self.strict:
            raise InputError(
                f"entity {without!r}",
                "",
                "expected a kind in the table of entities or the setting kinds",
            )
        phrases = [phrase_of.get(name) or self.words(name) for name in names]
        return pd.DataFrame(
            {
                "entity": names,
                "kind": [kinds.get(name, ENTITY) for name in names],
                "phrase": phrases,
            }
        )

    def _count_unmatched(self, names: Collection[str]) -> None:
        unmatched = sorted(set(map(clean, self.of_table)).difference(names))
        if len(unmatched) == len(self.of_table):
            raise InputError(
                "entities", "", f"expected entities of the triples, got {first_of(unmatched)}"
            )
        if unmatched:
            self.counts[f"{UNMATCHED}: {first_of(unmatched)}"] = len(unmatched)

    def _by_relation(
        self, triples: pd.DataFrame, rooms: Collection[str], kind_of: Mapping[str, str]
    ) -> dict[str, str]:
        """Kind by entity, from relations; InputError for two.
        Skips entities in ``kind_of`` unless ``household``.
        """
        by_relation = {clean(relation): ends for relation, ends in (self.kinds or {}).items()}
        ends: Mapping[str, Ends] = HOUSEHOLD if self.household else by_relation
        described = () if self.household else kind_of
        slots = {
            (relation, slot, name)
            for slot in ("head", "tail")
            for relation, name in zip(triples["relation"], triples[slot], strict=True)
            if relation in ends and name not in described
        }
        kind_and_place: dict[str, tuple[str, str]] = {}
        for relation, slot, name in sorted(slots):
            is_room = self.household and (relation, slot) == (AT_LOCATION, "tail") and name in rooms
            kind = "room" if is_room else getattr(ends[relation], slot)
            place = f"{slot} of {relation}"
            other, other_place = kind_and_place.setdefault(name, (kind, place))
            if other != kind:
                expected = f"expected one kind, got {other} ({other_place}) and {kind} ({place})"
                raise InputError(f"entity {name!r}", "", expected)
        return {name: kind for name, (kind, _) in kind_and_place.items()}


def _cleaned(texts: Mapping[str, str]) -> dict[str, str]:
    return {clean(name): clean(text) for name, text in texts.items()}


#: In a household, the phrase of an entity is its name.
household = Naming(household=True, words=str)
