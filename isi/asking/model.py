"""A kept embedding, ready to be asked."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
import torch
from torch import Tensor
from torch.nn.functional import normalize

from isi.asking.finding import find
from isi.base.errors import InputError
from isi.embeddings.family import Family
from isi.embeddings.stack import Embedding
from isi.graph import HEAD, RELATION, TAIL
from isi.inserting.given import family_of, stack_of_one, table
from isi.keeping.folder import ABOUT, VECTORS
from isi.keeping.kept import About, Kept
from isi.keeping.rows import cell_fault
from isi.learning.finite import LARGEST


@dataclass(frozen=True, eq=False)
class Model:
    """A kept embedding with its family."""

    kept: Kept
    family: Family

    @cached_property
    def embedding(self) -> Embedding:
        """As a stack of one, in single precision."""
        return stack_of_one(self.kept.entities, self.kept.relations, self.family)

    @cached_property
    def entity_ids(self) -> dict[str, int]:
        return {name: row for row, name in enumerate(self.kept.entity_names)}

    @cached_property
    def relation_ids(self) -> dict[str, int]:
        return {name: row for row, name in enumerate(self.kept.relation_names)}

    def entity(self, text: str, place: str) -> int:
        """The id of an entity as a user types it."""
        return find(text, self.entity_ids, place, "an entity of this embedding")

    def relation(self, text: str, place: str) -> int:
        """The id of a relation as a user types it."""
        return find(text, self.relation_ids, place, "a relation of this embedding")

    @cached_property
    def answers(self) -> dict[tuple[int, int, int], set[int]]:
        """Known answers by (given entity, relation, slot that is asked for)."""
        found: dict[tuple[int, int, int], set[int]] = defaultdict(set)
        for head, relation, tail in self.kept.triples.tolist():
            found[head, relation, TAIL].add(tail)
            found[tail, relation, HEAD].add(head)
        return dict(found)

    def scores(self, given: Tensor, relation: int, slot: int) -> Tensor:
        """Scores of all entities in a slot, beside each of some given entities; shapes (Q,), result (Q, E)."""
        relations = torch.full_like(given, relation)[None]
        if slot == TAIL:
            return self.embedding.score_tails(given[None], relations)[0]
        return self.embedding.score_heads(relations, given[None])[0]

    def candidates(self, relation: int, slot: int) -> Tensor:
        """Entities that may answer: those of a kind that a known triple of the relation has in the slot, or of none.

        All, where no kind is known to stand there.
        """
        kinds = {self.kept.kinds[row] for row in self.stands_in(relation, slot)} - {""}
        if not kinds:
            return torch.arange(len(self.kept.entities))
        return torch.tensor([row for row, kind in enumerate(self.kept.kinds) if not kind or kind in kinds])

    def nearest(self, entity: int, number: int) -> list[tuple[int, float]]:
        """The entities of nearest vectors with their cosines, best first."""
        vectors = normalize(self.embedding.entity[0], dim=-1)
        cosines = (vectors @ vectors[entity]).index_fill(0, torch.tensor(entity), -torch.inf)
        best = cosines.sort(descending=True, stable=True)
        shown = min(number, len(cosines) - 1)
        return list(zip(best.indices[:shown].tolist(), best.values[:shown].tolist(), strict=True))

    def stands_in(self, relation: int, slot: int) -> list[int]:
        """Entities that a known triple of a relation has in a slot, by id."""
        own = self.kept.triples[self.kept.triples[:, RELATION] == relation]
        return sorted(set(own[:, slot].tolist()))


def open_model(kept: Kept, folder: Path) -> Model:
    """A kept embedding, ready to be asked.

    Raises:
        InputError: where its family is unknown, its tables are not of that family, or it says what no terminal should.
    """
    _check_texts(folder / ABOUT, kept.about)
    check_numbers(folder / VECTORS, kept)
    try:
        family = family_of(kept.about.family, kept.about.family_options, kept.entities)
    except InputError as error:
        raise InputError(folder / ABOUT, "family", ": ".join(error.args[1:]).removeprefix(": ")) from error
    try:
        table(kept.relations, "relations", family.width(kept.entities.shape[1]))
    except InputError as error:
        raise InputError(folder / VECTORS, "tensor 'relations'", error.args[2]) from error
    return Model(kept, family)


def check_numbers(path: Path, kept: Kept) -> None:
    """Refuse numbers of which a score would be none in single precision.

    Raises:
        InputError: naming a row of such, and ``path``, where they come from.
    """
    for name, rows in (("entities", kept.entities), ("relations", kept.relations)):
        largest = np.abs(rows).max(1)
        if largest.max() > LARGEST:
            row = int(largest.argmax())
            raise InputError(path, f"{name}: row {row}", f"expected numbers up to {LARGEST:g}, got {largest[row]:.3g}")


def _check_texts(path: Path, about: About) -> None:
    """Refuse control characters in what is printed; names have none."""
    said = {f"inserted.{number}": one.model_dump() for number, one in enumerate(about.inserted)}
    if about.words is not None:
        said["words"] = about.words.model_dump()
    for place, texts in said.items():
        for key, text in texts.items():
            if isinstance(text, str) and (wrong := cell_fault(text)):
                raise InputError(path, f"{place}.{key}", wrong)
