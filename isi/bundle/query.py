"""Names as people type them: as they are written, else without regard to case and gaps (``turnOn``, ``turn on``).

A kept embedding, ready to be asked.
"""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from difflib import get_close_matches
from functools import cached_property
from pathlib import Path

import numpy as np
import torch
from torch import Tensor
from torch.nn.functional import normalize

from isi.bundle.folder import ABOUT, VECTORS, cell_fault
from isi.bundle.manifest import Bundle, Manifest
from isi.errors import InputError
from isi.graph.graph import HEAD, RELATION, TAIL
from isi.insertion.arguments import checked_model, stack_of_one, table
from isi.models.finite import LARGEST
from isi.models.model import Model
from isi.models.stack import Embedding

#: Names that are suggested, at most, and listed where none is near.
SUGGESTED, LISTED = 3, 8
_HUMP = re.compile(r"(?<=[a-z0-9])(?=[A-Z])")
_GAPS = re.compile(r"[\s_-]+")


def plain(name: str) -> str:
    """A name without what people type one way or another: ``hasAffordance`` and ``has affordance`` are the same."""
    return _GAPS.sub(" ", _HUMP.sub(" ", name)).strip().casefold()


def alike(one: str, other: str) -> bool:
    """Whether two names differ in no more than case and gaps."""
    return plain(one).replace(" ", "") == plain(other).replace(" ", "")


def find(text: str, ids: Mapping[str, int], place: str, what: str) -> int:
    """The id of a name.

    Args:
        place: where it was typed.
        what: it is to be the name of.

    Raises:
        InputError: where there is none, saying which was meant, probably; or where several could be.
    """
    if text in ids:
        return ids[text]
    same = [name for name in ids if alike(name, text)]
    if len(same) == 1:
        return ids[same[0]]
    if same:
        raise InputError(place, "", f"expected {what} as it is written: {listed(same)}; got {text!r:.80}")
    raise InputError(place, "", f"expected {what}, got {text!r:.80}{_meant(text, list(ids))}")


def _meant(text: str, names: Sequence[str]) -> str:
    """What was meant, as a question; of few names, which there are."""
    by_plain = {plain(name): name for name in names}
    wanted = plain(text)
    near = get_close_matches(wanted, by_plain, SUGGESTED) or [name for name in by_plain if wanted and wanted in name]
    if near:
        return f" (did you mean {listed([by_plain[name] for name in near[:SUGGESTED]], ' or ')}?)"
    return f" (there are {listed(names)})" if 0 < len(names) <= LISTED else ""


def listed(names: Sequence[str], between: str = ", ") -> str:
    """Names, quoted; not all where they are many."""
    more = [f"{len(names) - LISTED} more"] * (len(names) > LISTED)
    return between.join([*(repr(name) for name in names[:LISTED]), *more])


@dataclass(frozen=True, eq=False)
class OpenBundle:
    """A kept embedding with its family."""

    kept: Bundle
    family: Model

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


def open_bundle(kept: Bundle, folder: Path) -> OpenBundle:
    """A kept embedding, ready to be asked.

    Raises:
        InputError: where its family is unknown, its tables are not of that family, or it says what no terminal should.
    """
    _check_texts(folder / ABOUT, kept.about)
    check_numbers(folder / VECTORS, kept)
    try:
        family = checked_model(kept.about.family, kept.about.family_options, kept.entities.shape[1])
    except InputError as error:
        raise InputError(folder / ABOUT, "family", ": ".join(error.args[1:]).removeprefix(": ")) from error
    try:
        table(kept.relations, "relations", family.width(kept.entities.shape[1]))
    except InputError as error:
        raise InputError(folder / VECTORS, "tensor 'relations'", error.args[2]) from error
    return OpenBundle(kept, family)


def check_numbers(path: Path, kept: Bundle) -> None:
    """Refuse numbers of which a score would be none in single precision.

    Raises:
        InputError: naming a row of such, and ``path``, where they come from.
    """
    for name, rows in (("entities", kept.entities), ("relations", kept.relations)):
        largest = np.abs(rows).max(1)
        if largest.max() > LARGEST:
            row = int(largest.argmax())
            raise InputError(path, f"{name}: row {row}", f"expected numbers up to {LARGEST:g}, got {largest[row]:.3g}")


def _check_texts(path: Path, about: Manifest) -> None:
    """Refuse control characters in what is printed; names have none."""
    said = {f"inserted.{number}": one.model_dump() for number, one in enumerate(about.inserted)}
    if about.words is not None:
        said["words"] = about.words.model_dump()
    for place, texts in said.items():
        for key, text in texts.items():
            if isinstance(text, str) and (wrong := cell_fault(text)):
                raise InputError(path, f"{place}.{key}", wrong)
