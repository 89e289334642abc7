"""``hide``: a graph without some entities, their facts, and the queries about them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
import torch
from pydantic import Field

from isi.benchmark.evaluation import Evaluation, evaluation_of, ranks_frame, read
from isi.benchmark.graphs import graph_of, unweighted
from isi.benchmark.split import SplitIds, split_ids
from isi.config import Count, Fraction, Seed, check
from isi.errors import extra
from isi.evaluation.filtered import end_ranks
from isi.graph.graph import TAIL
from isi.insertion.arguments import naming_argument, triples_of
from isi.models.stack import usual_torch
from isi.random import stream
from isi.vocabulary import Vocabulary

if TYPE_CHECKING:
    from pykeen.triples import TriplesFactory

MOST_EARLIER = 1000  #: Maximum number of known triples in the sample of earlier triples.


@dataclass(frozen=True, eq=False, repr=False)
class HiddenSplit:
    """A graph some of whose entities are hidden, as ``hide`` returns it.

    Ids are those of ``known``: known entities come first, then the hidden ones in the order of
    ``facts``, in which ``isi.pykeen.insert`` and ``isi.insert`` append them.

    Example:
        >>> import isi, numpy as np
        >>> triples = [("mug", "in", "kitchen"), ("mug", "is a", "cup"), ("cup", "in", "kitchen")]
        >>> triples += [("bed", "in", "bedroom"), ("desk", "in", "bedroom"), ("bed", "is a", "cup")]
        >>> split = isi.benchmark.hide(triples, fewest=2, seed=1)
        >>> split.hidden, split.facts, split.queries.tolist()
        (['mug'], [('mug', 'is a', 'cup')], [['mug', 'in', 'kitchen']])
        >>> tables = {"entities": np.ones((6, 2)), "relations": np.ones((2, 2))}
        >>> done = split.evaluate("distmult", **tables)  # all scores are equal
        >>> done
        MRR of known ends 0.286, hidden ones 0.333, earlier triples 0.310
        >>> done.ranks.head(2)
            asked head relation     tail  slot  rank
        0   known  mug       in  kitchen  tail   3.5
        1  hidden  mug       in  kitchen  head   3.0
    """

    entities: list[str]  #: labels of all entities, the hidden ones last
    relations: list[str]  #: labels of all relations
    ids: SplitIds  #: the triples of all parts, in ids
    seed: int

    @property
    def hidden(self) -> list[str]:
        """Labels of the hidden entities."""
        return self.entities[self.ids.known :]

    @property
    def known(self) -> TriplesFactory:
        """The known triples as a triples factory of PyKEEN's, to train on."""
        with extra("pykeen"):
            from pykeen.triples import TriplesFactory

        entities, relations = self._known_names
        triples = torch.from_numpy(self.ids.triples)
        return TriplesFactory(triples, entities.ids, relations.ids)

    @property
    def _known_names(self) -> tuple[Vocabulary, Vocabulary]:
        """Known entities, and relations."""
        entities = Vocabulary("entity", self.entities[: self.ids.known])
        return entities, Vocabulary("relation", self.relations)

    @property
    def known_triples(self) -> np.ndarray:
        """Triples between known entities, as labels; shape (T, 3)."""
        return self.labels(self.ids.triples)

    @property
    def facts(self) -> list[tuple[str, str, str]]:
        """The triples from which hidden entities are inserted, as labels: one hidden and one known
        end. Those of an entity are in random order.
        """
        return self.facts_of(None)

    def facts_of(self, number: int | None) -> list[tuple[str, str, str]]:
        """At most ``number`` facts of each hidden entity, the first ones; None: all. 0: none, as
        in semi-inductive link prediction from words alone.
        """
        number = check(number, Annotated[int, Field(ge=0)] | None, "", "argument 'number'")  # type: ignore[arg-type]
        return [tuple(row) for row in self.labels(self.ids.insert_triples(number)).tolist()]

    @property
    def queries(self) -> np.ndarray:
        """Triples of a hidden and a known entity, whose ends are queried, as labels;
        shape (Q, 3).
        """
        return self.labels(self.ids.queries)

    def labels(self, triples: np.ndarray) -> np.ndarray:
        """Triples of ids, (N, 3), as labels."""
        entities, relations = np.array(self.entities, object), np.array(self.relations, object)
        head, relation, tail = triples.T
        return np.stack([entities[head], relations[relation], entities[tail]], 1)

    def __repr__(self) -> str:
        ids = self.ids
        return (
            f"{ids.known} known and {len(self.hidden)} hidden entities; triples: "
            f"{len(ids.triples):,} known, {len(ids.rest):,} facts, {len(ids.queries):,} queried"
        )

    @usual_torch()
    def evaluate(
        self,
        model: Any,
        factory: Any = None,
        *,
        entities: Any = None,
        relations: Any = None,
        model_options: Mapping[str, Any] | None = None,
        earlier: Any = None,
    ) -> Evaluation:
        """Rank the answers to three kinds of queries (``Evaluation``) among all entities.

        Ranks are filtered by all triples of the graph, and realistic: a tie counts ½. A model of
        the known entities alone is asked about earlier triples only, which gives their MRR before
        an insertion.

        Args:
            model: a model of PyKEEN's, a result of its pipeline, of ``isi.insert`` or of
                ``isi.pykeen.insert``; or the name of a model (or a ``Model``) of the tables
                ``entities``, (E + n, d), and ``relations``, (R, w), with its ``model_options``.
            factory: the triples factory of a model of PyKEEN's. None: its ids are the split's.
            earlier: triples of known entities, in any form of ``isi.insert`` or as a triples
                factory, such as validation triples. None: a sample of at most ``MOST_EARLIER`` of
                the known triples, the same in each call. They were trained on, so their MRR is
                high, but its change is the harm of an insertion.

        Raises:
            InputError: the model lacks entities of the split, or has others.
        """
        named = read(model, factory, entities, relations, model_options)
        theta = named.in_order(self.entities, self.ids.known, self.relations)
        number = theta.entity.shape[1]
        has_hidden = number > self.ids.known
        queries = self.ids.queries if has_hidden else self.ids.queries[:0]
        true = self.ids.true if has_hidden else self.ids.triples
        queried = np.concatenate([queries, self._earlier(earlier)])
        graph = unweighted(self.entities[:number], self.relations, np.concatenate([queried, true]))
        ranks = end_ranks(theta, graph, torch.arange(len(queried))).numpy()
        return evaluation_of(ranks_frame(self._parts(queried, len(queries), ranks)))

    def _earlier(self, earlier: Any) -> np.ndarray:
        """Ids of earlier triples, (V, 3), in any form; None: a sample of the known ones."""
        triples = self.ids.triples
        if earlier is None:
            order = stream(self.seed, "earlier triples of a benchmark").permutation(len(triples))
            return triples[np.sort(order[:MOST_EARLIER])]
        if hasattr(earlier, "mapped_triples"):
            from isi.pykeen.insertion import labelled

            earlier = labelled(earlier)
        return triples_of(earlier, "earlier", *self._known_names)

    def _parts(
        self, queried: np.ndarray, queries: int, ranks: np.ndarray
    ) -> list[tuple[str, np.ndarray, np.ndarray, np.ndarray]]:
        """Parts of ``ranks_frame``, from ranks of the heads and tails, (2, Q + V), of Q ``queries``
        and then V earlier triples.
        """
        labels, slots = self.labels(queried), np.array(["head", "tail"], object)
        hidden = (queried[:queries, TAIL] >= self.ids.known).astype(np.int64)
        rows, known = np.arange(queries), 1 - hidden
        parts = [
            ("known", slots[known], labels[:queries], ranks[known, rows]),
            ("hidden", slots[hidden], labels[:queries], ranks[hidden, rows]),
        ]
        for side in (0, 1):
            earlier = ranks[side, queries:]
            parts.append(("earlier", slots[np.full(len(earlier), side)], labels[queries:], earlier))
        return parts


@usual_torch()
def hide(
    triples: Any,
    *,
    fraction: float = 0.1,
    number: int | None = None,
    fewest: int = 5,
    queries: float = 0.2,
    seed: int = 0,
    root: int = 0,
) -> HiddenSplit:
    """Hide random entities of a graph: train on ``known``, insert from ``facts``, ``evaluate``.

    The other entities and all relations keep a triple of known entities. Triples between hidden
    entities are neither facts nor queries, but are right answers.

    Args:
        triples: labels or ids in any form of ``isi.insert``, each triple once; a triples factory of
            PyKEEN's; or a name: a folder of ``data/raw`` in the current folder (codex_s), else a
            dataset of PyKEEN's (umls, ...), with all its splits.
        fraction: share of the entities that is hidden, at least one; ``number``: how many are,
            instead of a share.
        fewest: minimum number of triples of a hidden entity with a known one, at least 2.
        queries: share of those triples that become queries, rounded down, at least one per hidden
            entity; the others are facts.
        seed: selects entities, facts and queries; ``root``: root seed of all ``seed``.

    Raises:
        InputError: names the wrong argument; too few entities can be hidden.

    Example:
        >>> import isi
        >>> ring = [(f"e{row}", "next", f"e{(row + 1) % 12}") for row in range(12)]
        >>> ring += [(f"e{row}", "after next", f"e{(row + 2) % 12}") for row in range(12)]
        >>> split = isi.benchmark.hide(ring, fraction=0.1, fewest=2)
        >>> split
        11 known and 1 hidden entities; triples: 20 known, 3 facts, 1 queried
        >>> split.facts
        [('e9', 'next', 'e10'), ('e8', 'after next', 'e10'), ('e10', 'after next', 'e0')]
    """
    fraction = check(fraction, Fraction, "", "argument 'fraction'")
    number = check(number, Count | None, "", "argument 'number'")  # type: ignore[arg-type]
    fewest = check(fewest, Annotated[int, Field(ge=2)], "", "argument 'fewest'")  # type: ignore[arg-type]
    queries = check(queries, Fraction, "", "argument 'queries'")
    seed = check(seed, Seed, "", "argument 'seed'")
    root = check(root, Seed, "", "argument 'root'")
    graph = graph_of(triples)
    rng = stream(root, "hidden from another trainer", seed)
    entities = len(graph.entities)
    hidden = max(1, round(fraction * entities)) if number is None else number
    with naming_argument("fraction" if number is None else "number"):
        ids = split_ids(graph.triples.numpy(), entities, hidden, fewest, queries, rng)
    return HiddenSplit([graph.entities[row] for row in ids.order], graph.relations, ids, seed)
