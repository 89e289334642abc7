"""The result of ``isi.insert``: enlarged tables, a report of each new entity,
interference with known answers.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import torch
from torch import Tensor
from torch.nn.functional import normalize

from isi.config import Count, Seed, check, is_whole, plain_number
from isi.errors import InputError, cut, short
from isi.evaluation.platt import Curves
from isi.graph.graph import HEAD, RELATION, TAIL
from isi.initializers.api import FALLBACKS, InitResult
from isi.initializers.scale import Scale
from isi.insertion.arguments import TripleForms, ids_of, triples_of
from isi.insertion.engine import Method, NovelEntities, train_together
from isi.insertion.hidden import HoldOut
from isi.insertion.interference import Interference, interference_of
from isi.insertion.probability import fit_curves
from isi.insertion.request import Checked, stack_of_one
from isi.insertion.selection import Selection, named
from isi.models.losses import loss_named
from isi.models.model import Model
from isi.models.stack import Embedding, usual_torch
from isi.vocabulary import Vocabulary

BUDGET = 2**24  #: Maximum number of cosines in one table.
MOST_WEIGHTS = 2**24  #: Maximum number of elements of ``Details.weights``.
TINY = 1e-12  #: Minimum length of a vector in a cosine.
SAME = 1e-6  #: A coordinate whose deviation is below this share of the largest one is ignored.
#: Maximum number of known vectors, evenly spaced by id, that define centre and deviation.
CLOUD = 2**16


@dataclass(frozen=True)
class Entity:
    """The report of a new entity."""

    name: str | int
    id: int
    insert_triples: int  #: number of triples with a known end
    between: int  #: number of triples whose ends are all new, which later rounds use
    #: the rule that replaced the initializer for lack of data: es, rs, centroid; or None
    fallback: str | None
    #: the entities whose centroid is the vector; None if it is no centroid
    indicators: list[str | int] | None
    #: known entities with the highest cosines, and the cosines
    nearest: list[tuple[str | int, float]]
    #: root mean square over coordinates of the z-score (mean and deviation of known vectors); 1 is
    #: typical
    distance: float
    farther_than: float  #: share of known vectors with a smaller distance


@dataclass(frozen=True, eq=False)
class Details:
    """All of an insertion: what was given, how it was computed, and its parts in ids."""

    vectors: np.ndarray  #: rows of the new entities; shape: (n, d)
    relations: np.ndarray  #: shape: (R + q, w)
    checked: Checked  #: what was given
    method: Method  #: the initializer, its options, and the reason for it
    test: HoldOut  #: hides known entities, which get as many insert triples as the new ones
    computed: InitResult | None  #: by the initializer; None without new entities

    @cached_property
    def entities(self) -> np.ndarray:
        """Rows of known entities, then of new ones: a copy, made on first use; shape (E + n, d)."""
        return np.concatenate([self.checked.entities, self.vectors])

    @property
    def model(self) -> Model:
        return self.checked.model

    @property
    def scale(self) -> Scale:
        """What scores mean: the loss of training, and what was fitted for it."""
        return self.test.scales[0]

    @property
    def known(self) -> int:
        """Number of known entities, whose ids come first."""
        return self.checked.novel.known

    @property
    def new(self) -> list[int]:
        """Ids of the new entities."""
        return list(range(self.known, self.known + len(self.vectors)))

    @property
    def new_relations(self) -> list[int]:
        """Ids of the new relations."""
        return list(range(self.checked.novel.known_relations, len(self.relations)))

    @property
    def names(self) -> Vocabulary:
        return self.checked.names

    @property
    def labels(self) -> Vocabulary:
        return self.checked.relation_names

    @property
    def insert_triples(self) -> np.ndarray:
        """Triples of a new and a known entity; shape (I, 3)."""
        novel = self.checked.novel
        triples: np.ndarray = novel.triples[novel.has_one_novel_end]
        return triples

    @property
    def between(self) -> np.ndarray:
        """Triples of two new entities, and of new relations between known ones; shape (B, 3)."""
        novel = self.checked.novel
        triples: np.ndarray = novel.triples[~novel.has_one_novel_end]
        return triples

    @property
    def known_triples(self) -> np.ndarray:
        return self.checked.novel.known_triples

    @property
    def options(self) -> Mapping[str, Any]:
        """Of the initializer."""
        return self.method.options

    @property
    def why(self) -> str:
        """The reason for this initializer."""
        return self.method.why

    @cached_property
    def fallback(self) -> list[str | None]:
        """For each new entity, the rule that replaced the initializer: es, rs, centroid or None."""
        if self.computed is None:
            return []
        return [FALLBACKS[code] for code in self.computed.fallback[0].tolist()]

    @cached_property
    def weights(self) -> np.ndarray | None:
        """Weights of known entities in each new vector (MAP: in the prior's mean);
        shape (n, E). None if the initializer has no weights, or n · E is too large.
        """
        if self.computed is None or self.computed.weights is None:
            return None
        if len(self.new) * self.known > MOST_WEIGHTS:
            return None
        weights: np.ndarray = self.computed.weights[0, :, : self.known].float().numpy()
        return weights

    @cached_property
    def indicators(self) -> list[list[int]] | None:
        """Ids of the indicators of each new entity; None if vectors are no centroids."""
        if self.computed is None or self.computed.indicators is None:
            return None
        return [row.nonzero()[:, 0].tolist() for row in self.computed.indicators[0]]

    @cached_property
    @usual_torch()
    def embedding(self) -> Embedding:
        """The tables as a stack of one embedding in single precision."""
        return stack_of_one(self.entities, self.relations, self.model)

    @property
    def novel(self) -> NovelEntities:
        """The new entities, and all that their vectors depend on, in the joined table."""
        return replace(self.checked.novel, theta=self.embedding)

    @cached_property
    def curves(self) -> Curves:
        """Probability by score, fitted to hidden known entities;
        InputError if too few of their triples are known.

        There must be new entities: the hidden ones get as many insert triples.
        """
        with usual_torch():
            draws = self.test.hide()
            curves = None if draws is None else fit_curves(draws, self.method)
        if curves is None:
            expected = (
                "expected more triples: known entities are hidden and inserted "
                f"by {self.method.initializer.name}, and the"
            )
            raise InputError(
                "argument 'known_triples'",
                "",
                f"{expected} answers about them calibrate probabilities",
            )
        return curves

    @usual_torch()
    def nearest(self, vectors: np.ndarray, number: int) -> list[tuple[list[int], list[float]]]:
        """For each of some vectors, (m, d), the ids of the known entities with the highest cosines,
        and the cosines.
        """
        known, chosen = self._known_vectors, torch.from_numpy(vectors.astype(np.float32))
        lengths = known.norm(dim=-1).clamp(min=TINY)
        parts = torch.split(normalize(chosen, dim=-1), max(1, BUDGET // self.known))
        best = [torch.topk(part @ known.T / lengths, min(number, self.known)) for part in parts]
        return [
            pair
            for part in best
            for pair in zip(part.indices.tolist(), part.values.tolist(), strict=True)
        ]

    @property
    def _known_vectors(self) -> Tensor:
        """Known vectors in single precision; shape (E, d)."""
        return self.checked.novel.theta.entity[0]

    @usual_torch()
    def from_cloud(self) -> tuple[list[float], list[float]]:
        """``distance`` and ``farther_than`` of each new entity.
        Coordinates with (almost) no deviation are ignored.
        """
        known = self._known_vectors[:: max(1, -(-self.known // CLOUD))].double()
        centre, deviation = known.mean(0), known.std(0, correction=0)
        alive = deviation > SAME * deviation.max()

        def distance(of: Tensor) -> Tensor:
            return (
                ((of.double() - centre) / deviation)[:, alive]
                .square()
                .sum(-1)
                .div(max(1, int(alive.sum())))
                .sqrt()
            )

        usual = distance(known).sort().values
        new = distance(torch.from_numpy(self.vectors.astype(np.float32)))
        return new.tolist(), (torch.searchsorted(usual, new) / len(usual)).tolist()


@dataclass(frozen=True, eq=False, repr=False)
class Inserted:
    """An embedding with new entities. The rows of known entities are unchanged.

    Nothing is changed in the tables that were passed to ``isi.insert``, and that of entities is not
    copied before ``entities`` joins both. Until then, the insertion can be rejected;
    ``interference`` shows its harm.
    """

    details: Details  #: all else that is known of the insertion
    selection: Selection | None  #: how the initializer was selected; None if it was not

    @property
    def vectors(self) -> np.ndarray:
        """Rows of the new entities; shape (n, d)."""
        return self.details.vectors

    @property
    def entities(self) -> np.ndarray:
        """Rows of known entities, then of new ones: a copy, made on first use; shape (E + n, d)."""
        return self.details.entities

    @property
    def relations(self) -> np.ndarray:
        """Rows of known relations, then of new ones; shape (R + q, w)."""
        return self.details.relations

    @property
    def entity_names(self) -> Sequence[str] | None:
        """Names of all entities; None if they have ids only."""
        return self.details.names.names

    @property
    def initializer(self) -> str:
        return self.details.method.initializer.name

    @property
    def harm(self) -> float | None:
        """The loss of MRR of earlier triples that the selection expects; None without one."""
        return None if self.selection is None else self.selection.selected.harm

    @usual_torch()
    def train(self, epochs: int = 5, **options: Any) -> Inserted:
        """The same insertion after further training of the new rows together, from their present
        vectors (``fold_in``). All other rows stay as they are. It has no ``selection`` and no
        ``harm``, which were those of the rows of before.

        Args:
            epochs: number of epochs; ``options``: others of ``fold_in``, such as ``share``.

        Example:
            >>> import isi, numpy as np
            >>> entities, relations = np.eye(2), np.ones((1, 2))
            >>> how = {"model": "distmult", "initializer": "mean"}
            >>> new = isi.insert(entities, relations, [(2, 0, 0)], new=1, **how)
            >>> first = new.vectors[0]
            >>> trained = new.train(epochs=5).vectors[0]
            >>> bool(first[0] == first[1]), bool(trained[0] > trained[1])
            (True, True)
        """
        epochs = check(epochs, Count, "", "argument 'epochs'")
        details = self.details
        method = named(
            "fold_in", {**options, "epochs": epochs}, details.model, details.checked.names.number
        )
        method = replace(method, trained_with=details.method.trained_with)
        working = details.checked.with_rows()
        novel = working.novel
        novel.theta.entity[0, novel.known :] = torch.from_numpy(details.vectors)
        novel.theta.relation[0] = torch.from_numpy(details.relations)
        start = InitResult(
            novel.theta.entity[:, novel.known :].clone(), torch.zeros(1, novel.number)
        )
        if details.computed is not None:
            start = replace(details.computed, vectors=start.vectors)
        scale = Scale(loss_named(method.trained_with))
        computed = train_together(replace(novel, scale=scale), method, start)
        vectors, relations = working.new_rows(method)
        details = replace(details, vectors=vectors, relations=relations, computed=computed)
        return Inserted(details, None)

    def __repr__(self) -> str:
        details = self.details
        of, relation_of = details.names.of, details.labels.of
        lines = [
            (
                f"{len(details.new)} new beside {details.known} known entities, "
                f"inserted from {len(details.insert_triples)} triples"
            )
        ]
        for label, names, rows in (
            ("new", of, details.new),
            ("new relations", relation_of, details.new_relations),
        ):
            if rows:
                lines.append(
                    f"{label}: {', '.join(str(names(row)) for row in rows[:10])}"
                    f"{', ...' * (len(rows) > 10)}"
                )
        for first in details.new[:1]:
            ((ids, cosines),) = details.nearest(details.vectors[:1], 5)
            near = ", ".join(
                f"{of(row)} {cosine:.2f}" for row, cosine in zip(ids, cosines, strict=True)
            )
            lines += [
                f"initializer: {self.initializer}, {details.why}",
                f"nearest to {of(first)}: {near}",
            ]
        return "\n".join(cut(" ".join(line.split()), 120) for line in lines)

    def report(self, nearest: int = 5) -> list[Entity]:
        """The report of each new entity; ``nearest``: the number of
        nearest known entities in it.
        """
        nearest = check(nearest, Seed, "", "argument 'nearest'")
        details = self.details
        of = details.names.of
        inserted, between = (
            Counter(end for head, _, tail in triples.tolist() for end in {head, tail})
            for triples in (details.insert_triples, details.between)
        )
        near = details.nearest(details.vectors, nearest)
        distances, shares = details.from_cloud()
        return [
            Entity(
                of(row),
                row,
                inserted[row],
                between[row],
                details.fallback[place],
                None if details.indicators is None else list(map(of, details.indicators[place])),
                list(zip(map(of, near[place][0]), near[place][1], strict=True)),
                distances[place],
                shares[place],
            )
            for place, row in enumerate(details.new)
        ]

    @usual_torch()
    def probability(self, triples: TripleForms) -> np.ndarray:
        """The calibrated probability that each triple of a new entity is true, by its score;
        shape (T,), float64.

        A triple counts as an answer to a query about the new entity, (new, relation, ?) or (?,
        relation, known), that has a right answer; the probability is the share of right answers
        among answers of equal score. If the relation may have no answer for the entity, it is too
        high. docs/insert.md says how well it holds.

        Args:
            triples: names or ids in any form that ``isi.insert`` accepts, each with a new entity;
                duplicates stay.

        Raises:
            InputError: names the triple without a new entity; there are too few known triples.
        """
        details = self.details
        ids = ids_of(triples, "triples", details.names, details.labels)
        for row in np.flatnonzero((ids[:, [HEAD, TAIL]] < details.known).all(1))[:1].tolist():
            raise InputError(
                "argument 'triples'",
                f"triple {row}",
                "expected a new entity, but both ends are known",
            )
        if not len(ids):
            return np.zeros(0)
        head, relation, tail = torch.from_numpy(ids).T[:, None]
        scores = details.embedding.score(head, relation, tail)[0].numpy()
        return details.curves(scores, ids[:, RELATION])

    @usual_torch()
    def interference(
        self,
        triples: TripleForms | None = None,
        most: int = 256,
        seed: int = 0,
        original: int | None = None,
        show: int = 5,
    ) -> Interference:
        """Measure how far new entities push known answers down. This changes nothing:
        the insertion may be rejected.

        Args:
            triples: of old entities, to query, held out or trained; None: ``known_triples``.
                InputError if none.
            most: maximum number of queried triples; a larger set is sampled at random.
            seed: root seed of the sample.
            original: number of old entities, the first rows; None: those before this insertion.
                After a row of insertions, the number before the first one gives the effect of the
                whole row. If ``known_triples`` grew only at its end, the same triples are queried
                after each insertion, with the same ``h_old``.
            show: maximum number of ``changes``.
        """
        details = self.details
        seed = check(seed, Seed, "", "argument 'seed'")
        most = check(most, Count, "", "argument 'most'")
        show = check(show, Seed, "", "argument 'show'")
        old = details.known if original is None else plain_number(original)
        if not is_whole(old) or not 0 < old <= details.known:
            expected = (
                f"expected a number of entities from 1 to {details.known}, got {short(original)}"
            )
            raise InputError("argument 'original'", "", expected)
        if triples is None:
            queried = details.known_triples[(details.known_triples[:, [HEAD, TAIL]] < old).all(1)]
        else:
            queried = triples_of(triples, "triples", details.names, details.labels)
        if not len(queried) or (queried[:, [HEAD, TAIL]] >= old).any():
            raise InputError(
                "argument 'triples'",
                "",
                "expected triples of known entities, which give the queries",
            )
        true = details.insert_triples, details.known_triples
        names = details.names, details.labels
        return interference_of(details.embedding, *names, queried, true, old, most, seed, show)
