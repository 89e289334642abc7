"""The hold-out test: known entities are hidden, inserted again, and queried.

Known entities are hidden together, as many as are to be inserted or a tenth: their rows are left
out, and an initializer computes them again from as many of their own triples as the new entities
have. Filtered ranks in queries of their other triples, and of triples of the other entities,
measure both sides. The known vectors were trained together with the hidden entities, which flatters
all initializers alike: compare their measures with each other only.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from operator import itemgetter
from typing import Any

import numpy as np
import torch
from torch import Tensor
from torch.nn.utils.rnn import pad_sequence

from isi.errors import InputError
from isi.evaluation.filtered import EndQueries, end_queries, random_ranks
from isi.evaluation.ranks import ahead
from isi.graph.graph import HEAD, TAIL, Graph
from isi.graph.sessions import OUT, TRAIN, Session, membership, touches
from isi.initializers.api import NoRelationMap, options_of
from isi.initializers.context import InitContext, context_in_session, trained_session
from isi.initializers.scale import Scale, fit_scale
from isi.insertion.engine import Method
from isi.models.losses import Loss, TrainingLoss
from isi.models.stack import Embedding
from isi.random import stream

ONE_IN = 10  #: At most one in so many known entities is hidden at a time.
#: Insertions come in rows: harm is that of so many new entities at least.
ROW = 12
#: The losses that are tried where that of training is unknown.
TRIED: tuple[Loss, ...] = ("logistic", "softmax", "margin")
HIDDEN = 48  #: Maximum number of hidden entities in all.
#: Maximum number of queried triples per hidden entity, and least number in all.
QUERIES, LEAST_QUERIES = 6, 16
KEPT_BACK = 4  #: At least one in so many triples of a hidden entity is queried and not inserted.
MOST_SCORES = 2**23  #: Maximum number of scores in one table.
#: Rank of the second-best wrong answer, which is the proxy for an answer that is true but was not
#: trained on.
PROXY_RANK = 2
#: The loss of triples of training and of proxies is larger than that of triples that were not
#: trained on, by this share (compared in docs/benchmarks/hidden.csv).
EXCESS = 0.4


@dataclass(frozen=True)
class Trial:
    """An initializer with options, and filtered MRRs after it has inserted the hidden entities."""

    initializer: str
    options: Mapping[str, Any]
    trained_with: Loss  #: the assumed loss of training, which says what scores mean
    known_ends: float  #: of the known end of a hidden entity's triple, given the hidden entity
    hidden_ends: float  #: of the hidden entity, given the known end
    h_old: float  #: of earlier triples, among the other known entities
    h_cur: float  #: of the same, when all new entities (or ``ROW`` of them) have been inserted
    #: estimated loss of MRR of earlier triples: of those that were not trained on, where these are
    #: given; else the mean of those of training and of proxies for others (``PROXY_RANK``),
    #: corrected (``EXCESS``)
    harm: float

    @property
    def about(self) -> float:
        """Mean MRR of both kinds of queries about hidden entities."""
        return (self.known_ends + self.hidden_ends) / 2


@dataclass(frozen=True, eq=False)
class HiddenDraws:
    """M draws of n hidden known entities, and the triples that are
    queried after their insertion.
    """

    context: InitContext  #: its novel entities are the hidden ones
    about: EndQueries  #: triples of hidden entities, without their insert triples
    earlier: EndQueries  #: triples of the other entities
    share: float  #: number of new entities that ``h_cur`` is for, divided by n
    are_trained: bool  #: whether ``earlier`` were trained on

    def with_scale(self, scale: Scale) -> HiddenDraws:
        """The same draws with other log odds."""
        return replace(self, context=replace(self.context, scale=scale))

    def starting_at(self, vectors: Tensor) -> HiddenDraws:
        """The same draws, in which optima are sought near vectors, (M, n, d)."""
        return replace(self, context=replace(self.context, start=vectors))

    @cached_property
    def competes(self) -> Tensor:
        """Competitors of the answers of ``earlier`` before the insertion;
        shape (2, M, Q, E), bool.
        """
        hidden = membership(self.context.novel, self.context.known.shape[1])
        return ~(self.earlier.right | hidden[:, None])

    @cached_property
    def before(self) -> tuple[Tensor, Tensor]:
        """Scores and ranks of answers of ``earlier`` before the insertion; shapes (A, 2, M, Q).

        If the model was trained on the right answer, the second-best wrong one stands for answers
        that were not trained on, whose ranks are not as safe: A is 2.
        """
        theta0 = self.context.theta0
        scores = self.earlier.scores(theta0, theta0.entity)
        right = self.earlier.right_scores(theta0)
        if not self.are_trained:
            return right[None], (1 + ahead(scores, right, self.competes))[None]
        wrong = scores.masked_fill(~self.competes, -torch.inf)
        proxy = wrong.topk(min(PROXY_RANK, scores.shape[-1])).values[..., -1]
        rank = 1 + ahead(scores, right, self.competes)
        rank_of_proxy = torch.full(right.shape, float(PROXY_RANK))
        return torch.stack([right, proxy]), torch.stack([rank, rank_of_proxy])

    @property
    def random_mrr(self) -> float:
        """Expected MRR of earlier triples if their ranks were random."""
        return random_ranks(self.competes, self.earlier).mean().item()

    def insert(self, method: Method) -> tuple[Method, Tensor] | None:
        """The method with all its options, and the vectors of the hidden entities, (M, n, d);
        None if not all are finite.
        """
        context, initializer = self.context, method.initializer
        if initializer.starts_from:  # of its own, as in an insertion
            context = replace(context, start=None)
        try:
            options = options_of(initializer.name, method.options, "initializer")
            vectors = initializer.initialize(context, options).vectors
        except (InputError, NoRelationMap):
            return None
        return replace(method, options=options), vectors

    def theta(self, vectors: Tensor) -> Embedding:
        """The embedding with vectors of the hidden entities, (M, n, d)."""
        theta0, places = self.context.theta0, self.context.novel[..., None].expand_as(vectors)
        return replace(theta0, entity=theta0.entity.scatter(1, places, vectors))

    def trial(self, method: Method) -> Trial | None:
        """The trial of a method; None if it has no finite vectors for the hidden entities."""
        inserted = self.insert(method)
        return None if inserted is None else self.trial_of_vectors(*inserted)

    def trial_of_vectors(self, method: Method, vectors: Tensor) -> Trial:
        """The trial of a method that has inserted the hidden entities; ``vectors``: (M, n, d)."""
        ranks = self._ranks_about(vectors)
        novel, asked = self.context.novel, self.about.counted
        is_hidden = (self.about.answers[..., None] == novel[:, None]).any(-1)
        before, after = self._ranks_of_earlier(vectors)
        counted = self.earlier.counted
        harm = (1 / before - 1 / after).double()[..., counted].mean().item()
        if self.are_trained:
            harm *= 1 - EXCESS
        return Trial(
            method.initializer.name,
            method.options,
            self.context.scale.training.name,
            known_ends=_mrr(ranks[asked & ~is_hidden]),
            hidden_ends=_mrr(ranks[asked & is_hidden]),
            h_old=_mrr(before[0][:, counted]),
            h_cur=_mrr(after[0][:, counted]),
            harm=harm,
        )

    def _ranks_about(self, vectors: Tensor) -> Tensor:
        """Ranks in queries about hidden entities with ``vectors``, (M, n, d); shape (2, M, Q)."""
        theta = self.theta(vectors)
        scores = self.about.scores(theta, theta.entity)
        return 1 + ahead(scores, self.about.right_scores(theta), ~self.about.right)

    def _ranks_of_earlier(self, vectors: Tensor) -> tuple[Tensor, Tensor]:
        """Ranks of the answers to ``earlier`` before and after the insertion;
        shapes (A, 2, M, Q).
        """
        places = self.context.novel[:, None].expand(*self.earlier.right.shape[:3], -1)
        wrong = ~self.earlier.right.gather(-1, places)
        scores = self.earlier.scores(self.theta(vectors), vectors)
        answers, before = self.before
        added = torch.stack([ahead(scores, answer, wrong) for answer in answers])
        return before, before + self.share * added


def _mrr(ranks: Tensor) -> float:
    return (1 / ranks).double().mean().item()


def _no_triples() -> np.ndarray:
    return np.empty((0, 3), np.int64)


@dataclass(frozen=True, eq=False)
class HoldOut:
    """Data for the hold-out test."""

    theta0: Embedding  #: known entities and relations alone; one score per triple (``one_score``)
    triples: np.ndarray  #: known triples; ids, shape: (K, 3)
    numbers: np.ndarray  #: number of insert triples of each new entity; shape: (n,)
    words: np.ndarray | None  #: of the known entities, shape: (E, v); None: not used
    kinds: np.ndarray | None  #: of the known entities, shape: (E,)
    seed: int
    loss: Loss | TrainingLoss | None = "logistic"  #: of the embedding's training; None: unknown
    #: triples of known entities that were not trained on; ids, shape: (V, 3)
    validation: np.ndarray = field(default_factory=_no_triples)

    @cached_property
    def scales(self) -> list[Scale]:
        """The scale of the loss; if that is unknown, those of ``TRIED``."""
        losses = TRIED if self.loss is None else (self.loss,)
        triples = torch.from_numpy(self.triples)
        return [fit_scale(self.theta0, triples, loss) for loss in losses]

    def hide(self, most: int = HIDDEN) -> HiddenDraws | None:
        """Hide up to ``most`` entities, a tenth of the known ones at a time;
        None with too few triples to query.

        Entities with more triples than the median new one come first, at random. In each draw, the
        better connected hidden entities get the larger ``numbers`` of insert triples, if they have
        them.
        """
        rng, known = stream(self.seed, "hidden known entities"), self.theta0.entity.shape[1]
        ends = self.triples[:, [HEAD, TAIL]]
        degree = np.bincount(ends[ends[:, 0] != ends[:, 1]].flatten(), minlength=known)
        tenth = max(1, known // ONE_IN)
        together = min(tenth, most // -(-most // tenth))
        queried = self.validation if len(self.validation) >= LEAST_QUERIES else self.triples
        ends_queried = queried[:, [HEAD, TAIL]]
        order = self._order(degree, rng)
        draws = min(most, len(order)) // together
        novel = order[: draws * together].reshape(draws, together)
        each = min(QUERIES * together, MOST_SCORES // known // max(1, draws))
        inserted, about, earlier = list[list[int]](), list[list[int]](), list[list[int]]()
        for draw, hidden in enumerate(novel):
            hidden[:] = hidden[np.argsort(-degree[hidden], kind="stable")]
            facts = np.sort(np.resize(rng.permutation(self.numbers), together))[::-1]
            touching = np.isin(ends, hidden).sum(1)
            held_out = list[tuple[int, int]]()
            for place, entity in enumerate(hidden):
                alone = (ends == entity).any(1) & (touching == 1)
                of_entity = rng.permutation(np.flatnonzero(alone))
                count = min(facts[place], len(of_entity) - -(-len(of_entity) // KEPT_BACK))
                inserted += [[draw, place, triple] for triple in np.sort(of_entity[:count])]
                held_out += enumerate(of_entity[count:].tolist())
            held_out.sort(key=itemgetter(0))  # the first of each entity, ...
            about.append([triple for _, triple in held_out[:each]])
            is_other = ~np.isin(ends_queried, hidden).any(1)
            earlier.append(rng.permutation(np.flatnonzero(is_other))[:each].tolist())
        if sum(map(len, about)) < LEAST_QUERIES or sum(map(len, earlier)) < LEAST_QUERIES:
            return None
        graph = trained_session(self.triples, self.theta0, self.kinds).graph
        context = self._context(graph, torch.from_numpy(novel), inserted)
        share = max(ROW, len(self.numbers)) / together
        are_trained = queried is self.triples
        # all known triples are right answers, whether they were trained on or not
        every = np.concatenate([queried, self.validation if are_trained else self.triples])
        of_all = trained_session(every, self.theta0).graph
        asked = end_queries(graph, _padded(about)), end_queries(of_all, _padded(earlier))
        draws_of = HiddenDraws(context, *asked, share, are_trained)
        return draws_of.with_scale(self.scales[0])

    def _order(self, degree: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        """Ids of entities that may be hidden, in the order of hiding."""
        enough = np.median(self.numbers) + 1
        order = np.lexsort((rng.random(len(degree)), -np.minimum(degree, enough)))
        suitable = degree >= min(2, 1 + self.numbers.max())
        if self.words is not None:
            suitable &= self.words.any(1)
        in_order: np.ndarray = order[suitable[order]]
        return in_order

    def _context(self, graph: Graph, novel: Tensor, insert_triples: list[list[int]]) -> InitContext:
        """What an initializer sees of hidden entities, (M, n); rows of these are zero."""
        draws, known = len(novel), self.theta0.entity.shape[1]
        mask = membership(novel, known)
        splits = touches(graph, mask).to(torch.int8) * (OUT - TRAIN) + TRAIN
        words = torch.zeros(known, 1) if self.words is None else torch.from_numpy(self.words)
        theta = replace(
            self.theta0,
            entity=self.theta0.entity * ~mask[..., None],
            relation=self.theta0.relation.repeat(draws, 1, 1),
        )
        session = Session(graph, ~mask, splits)
        context = context_in_session(
            theta,
            session,
            novel,
            torch.tensor(insert_triples, dtype=torch.int64).view(-1, 3),
            words,
            self.seed,
            torch.arange(draws)[:, None],
        )
        return replace(context, by_kind=self.kinds is not None)


def _padded(lists: list[list[int]]) -> Tensor:
    """Lists of ids as a table, padded with -1 to the longest."""
    rows = [torch.tensor(ids, dtype=torch.int64) for ids in lists]
    return pad_sequence(rows, batch_first=True, padding_value=-1)
