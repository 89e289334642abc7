"""How what a user brings is named: what a name may be, and which kind and phrase an entity has."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import dataclass, field
from typing import Annotated

import pandas as pd
from pydantic import Field

from isi.config import Section
from isi.errors import InputError, short
from isi.sources._household import entity_name, household

#: Characters of a name, at most.
LONGEST = 200
#: Of entities of which nothing says what kind they are.
ENTITY = "entity"

Kind = Annotated[str, Field(min_length=1, max_length=LONGEST)]


class Ends(Section):
    """The kinds of a relation's heads and tails."""

    head: Kind
    tail: Kind


#: By relation.
Kinds = Annotated[dict[str, Ends], Field(min_length=1)]


def fault(name: object) -> str | None:
    """What is wrong with a name; null where nothing is."""
    if not isinstance(name, str) or not name:
        return "expected a name, got none"
    if len(name) > LONGEST:
        return f"expected a name of at most {LONGEST} characters, got {len(name):,}: {short(name)}"
    if not name.isprintable() or name != name.strip() or "../" in name:
        return f"expected a name without control characters, space around it or '../', got {short(name)}"
    return None


@dataclass
class Naming:
    """Names the entities of a source: their kinds by name, else by relation, else ``ENTITY`` where neither is set."""

    kinds: Kinds | None = None
    #: whether relations and kinds are those of homes, by what is named as a room
    household: bool = False
    #: of entities that a table, or the file itself, tells about
    kind_of: dict[str, str] = field(default_factory=dict)
    phrase_of: dict[str, str] = field(default_factory=dict)
    #: whether an entity of which nothing says its kind is an error
    strict: bool = False

    def __call__(self, triples: pd.DataFrame, rooms: Collection[str]) -> pd.DataFrame:
        """Entities of the triples in alphabetical order (``tables.KINDS``).

        Raises:
            InputError: where one has no kind, or its relations give it two.
        """
        kinds = dict(self._by_relation(triples, rooms)) | self.kind_of
        names = sorted({*triples["head"], *triples["tail"]})
        without = next((name for name in names if name not in kinds), None)
        if without is not None and self.strict:
            raise InputError(f"entity {without!r}", "", "expected its kind, from the table of entities or by relation")
        phrases = [self.phrase_of.get(name) or phrase(name) for name in names]
        return pd.DataFrame({"entity": names, "kind": [kinds.get(name, ENTITY) for name in names], "phrase": phrases})

    def _by_relation(self, triples: pd.DataFrame, rooms: Collection[str]) -> Iterator[tuple[str, str]]:
        """Entities that are not told about, with the kinds that relations give them."""
        if self.household:
            named = household(triples, rooms)
            yield from zip(named["entity"], named["kind"], strict=True)
        kinds = self.kinds or {}
        unknown = set(kinds) - set(triples["relation"])
        if unknown:
            raise InputError("kinds", f"relation {min(unknown)!r}", "no triple has it")
        found: dict[str, tuple[str, str]] = {}
        for relation, ends in kinds.items():
            own = triples[triples["relation"] == relation]
            for slot in ("head", "tail"):
                kind = getattr(ends, slot)
                for name in sorted(set(own[slot]) - set(self.kind_of)):
                    other, where = found.setdefault(name, (kind, f"{slot} of {relation}"))
                    if other != kind:
                        expected = f"expected one kind, got {other} ({where}) and {kind} ({slot} of {relation})"
                        raise InputError(f"entity {name!r}", "", expected)
                    yield name, kind


def phrase(name: str) -> str:
    """The words of a name: ``TVStand`` and ``tv_stand`` → ``tv stand``."""
    return " ".join(entity_name(name.replace("_", " ")).split()) or name
