"""The default initializer of ``isi.insert``:
the best for hidden known entities that does not harm earlier triples.

Known entities are hidden, a tenth at a time: their rows are left out, and each candidate computes
them again from as many of their own triples as the new entities have. Filtered ranks in queries of
their other triples, and of triples of the other entities, measure both sides. The known vectors
were trained together with the hidden entities, which flatters all candidates alike: compare their
measures with each other only.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from operator import itemgetter
from typing import TYPE_CHECKING, Any

import numpy as np
import torch
from torch import Tensor
from torch.nn.utils.rnn import pad_sequence

from isi.errors import InputError
from isi.evaluation.ranking import TIE
from isi.graph.graph import HEAD, TAIL, Graph
from isi.graph.sessions import OUT, TRAIN, Session, membership, touches
from isi.initializers.api import InitContext, NoRelationMap, Registered, context_of, options_of
from isi.initializers.evidence import SAMPLE
from isi.insertion.arguments import trained_session
from isi.models.stack import Embedding, rows
from isi.random import stream

if TYPE_CHECKING:
    import pandas as pd

#: One in so many known entities is hidden at a time; ``h_cur`` is for as many new entities.
ONE_IN = 10
#: Number of hidden entities in all, and the least number for which candidates are left out to save
#: work.
HIDDEN, LEAST_HIDDEN = 48, 20
#: Maximum number of queried triples per hidden entity, and least number in all.
QUERIES, LEAST_QUERIES = 6, 16
KEPT_BACK = 4  #: At least one in so many triples of a hidden entity is queried and not inserted.
MOST_SCORES = 2**23  #: Maximum number of scores in one table.
#: Multiplications in a second, and as many as the overhead of one candidate takes. They turn a
#: budget of seconds into one of work, so that the choice depends on the arguments alone and not on
#: a clock.
RATE, OVERHEAD = 1.4e10, 7e7
#: Rank of the wrong answer that stands for right ones that the model was not trained on.
SECOND = 2
STEPS = 8  #: Assumed number of steps of Newton's method.
#: As many multiplications of a product take the time of a step's work on one number of a vector.
ELEMENTWISE = 300
#: The MRR of earlier triples is near chance if it is below so many times that of random ranks.
NEAR_RANDOM = 2.0


@dataclass(frozen=True)
class Candidate:
    """An initializer with options, and filtered MRRs after it has inserted the hidden entities."""

    initializer: str
    options: Mapping[str, Any]
    known_ends: float  #: of the known end of a hidden entity's triple, given the hidden entity
    hidden_ends: float  #: of the hidden entity, given the known end
    h_old: float  #: of earlier triples, among the other known entities
    h_cur: float  #: of the same, when a tenth more entities (or all new ones) have been inserted
    #: mean loss of MRR of earlier triples, and of answers that stand for held-out ones (``SECOND``)
    loss: float

    @property
    def about(self) -> float:
        """Mean MRR of both kinds of queries about hidden entities."""
        return (self.known_ends + self.hidden_ends) / 2


@dataclass(frozen=True)
class Choice:
    """The candidates for the default initializer, and the chosen one."""

    candidates: list[Candidate]
    chosen: Candidate
    tolerance: float  #: largest loss of MRR that is no harm
    hidden: int  #: number of hidden entities
    queries: int  #: number of their queried triples
    most_hidden: int  #: largest number of hidden entities that the budget allows
    random_mrr: float  #: expected MRR of earlier triples at random ranks

    @property
    def why(self) -> str:
        return (
            f"the best of {len(self.candidates)} candidates for {self.hidden} hidden known entities"
        )

    @property
    def warnings(self) -> list[str]:
        """Sentences: even the best harms; the model has not learned its own triples."""
        best, harmful, untrained = self.chosen, [], []
        if best.loss > self.tolerance:
            harmful.append(
                f"every candidate harms: {best.initializer} harms least, and with it the MRR of"
                f" earlier triples falls by {best.loss:.3f} (tolerance {self.tolerance:g};"
                f" of trained triples from {best.h_old:.3f} to {best.h_cur:.3f})"
            )
        if best.h_old < NEAR_RANDOM * self.random_mrr:
            untrained.append(
                f"the model ranks its own triples almost at random (MRR {best.h_old:.3f}, at random"
                f" {self.random_mrr:.3f}): no vector of a new entity "
                "helps before it is trained longer"
            )
        return harmful + untrained

    @property
    def expected(self) -> dict[str, float]:
        """The measures of the chosen candidate."""
        return {
            name: value for name, value in asdict(self.chosen).items() if isinstance(value, float)
        }

    def to_frame(self) -> pd.DataFrame:
        """A row per candidate: the fields of ``Candidate``, number of queried triples,
        whether it was chosen.
        """
        import pandas as pd

        listed = [
            asdict(each) | {"queries": self.queries, "chosen": each is self.chosen}
            for each in self.candidates
        ]
        return pd.DataFrame(listed)


def choose_by_rule(about: Sequence[float], loss: Sequence[float], tolerance: float) -> int:
    """The first place of the highest ``about`` among losses of at most ``tolerance``;
    if none, of the least loss.
    """
    harmless = [place for place, lost in enumerate(loss) if lost <= tolerance]
    return (
        max(harmless, key=about.__getitem__)
        if harmless
        else min(range(len(loss)), key=loss.__getitem__)
    )


def calibrated(
    initializers: Sequence[Registered],
    theta0: Embedding,
    triples: np.ndarray,
    numbers: np.ndarray,
    words: np.ndarray | None,
    kinds: np.ndarray | None,
    seed: int,
    tolerance: float,
    budget: float,
) -> Choice | None:
    """Choose among initializers, each with its defaults and with the
    options in its ``calibration``.

    None if there are too few known triples, or the embedding is too large for the budget.

    Args:
        initializers: those whose needs are met by the model and the data; the first is always
            compared.
        theta0: the known entities, a stack of one embedding; ``words``, (E, v), and ``kinds``,
            (E,), are theirs.
        triples: known triples; ids, shape (K, 3).
        numbers: number of insert triples of each new entity, shape (n,).
        tolerance: largest loss of the MRR of earlier triples that is no harm.
        budget: seconds of one core, by an estimate of the work; limits the number of hidden
            entities, and if these are few, that of candidates: defaults, the cheaper first, come
            before other options.
    """
    work = {each.name: work_of(each, theta0, triples, numbers, words) for each in initializers}
    first, *others = initializers
    ordered = [first, *sorted(others, key=lambda each: work[each.name])]
    settings = [(each, dict(each.defaults)) for each in ordered]
    for each in ordered:
        # with facts, no more than one by words alone
        if each.needs != ("words",) or not numbers.any():
            settings += [(each, {**each.defaults, **options}) for options in each.calibration]
    total = np.cumsum([work[each.name] for each, _ in settings])
    # hidden entities, for each prefix
    possible = (budget * RATE - OVERHEAD * np.arange(1, len(settings) + 1)) / total
    affordable = int((possible >= min(LEAST_HIDDEN, theta0.entity.shape[1])).sum())
    if not affordable:
        return None
    number = min(HIDDEN, int(possible[affordable - 1]))
    draws = hide(theta0, triples, numbers, words, kinds, seed, number)
    if draws is None:
        return None
    measured = (draws.measure(each, options) for each, options in settings[:affordable])
    candidates = [candidate for candidate in measured if candidate is not None]
    if not candidates:
        return None
    place = choose_by_rule(
        [each.about for each in candidates], [each.loss for each in candidates], tolerance
    )
    hidden, queries = draws.context.novel.numel(), int(draws.about.counted.sum())
    return Choice(
        candidates, candidates[place], tolerance, hidden, queries, number, draws.random_mrr
    )


def work_of(
    initializer: Registered,
    theta0: Embedding,
    triples: np.ndarray,
    numbers: np.ndarray,
    words: np.ndarray | None,
) -> float:
    """Estimated number of multiplications for each hidden entity:
    to insert it, and to rank the queries about it.
    """
    _, entities, dimension = theta0.entity.shape
    ranking = 2 * QUERIES * entities * (dimension + 20)
    if initializer.cost == "pairs":
        return ranking + entities**2 * (1 if words is None else words.shape[1])
    if initializer.cost == "entities":
        return ranking + 4 * entities * dimension
    numbers_of_triples = (
        numbers.mean() * entities,
        numbers.mean() * theta0.relation.shape[1],
        2 * len(triples),
    )
    for_each = dimension * (dimension + (0 if theta0.model.linear else ELEMENTWISE))
    return ranking + STEPS * sum(min(SAMPLE, number) for number in numbers_of_triples) * for_each


@dataclass(frozen=True)
class Queried:
    """Triples of a stack whose head and tail are queried;
    a first axis of size 2 is for heads, then tails.
    """

    triples: Tensor  #: ids of head, relation and tail; shape: (M, Q, 3)
    counted: Tensor  #: false for padding; shape: (M, Q), bool
    right: Tensor  #: right answers, which are no competitors; shape: (2, M, Q, E), bool

    @property
    def answers(self) -> Tensor:
        """Ids; shape (2, M, Q)."""
        return self.triples[..., [HEAD, TAIL]].movedim(-1, 0)

    def scores(self, theta: Embedding, candidates: Tensor) -> Tensor:
        """Scores of vectors (M, C, d) as heads, then as tails; shape (2, M, Q, C)."""
        head, relation, tail = self.triples.unbind(-1)
        heads, relations, tails = (
            rows(theta.entity, head),
            rows(theta.relation, relation),
            rows(theta.entity, tail),
        )
        by_tail, by_head = theta.model.score_heads, theta.model.score_tails
        return torch.stack(
            [by_tail(tails, relations, candidates), by_head(heads, relations, candidates)]
        )

    def right_scores(self, theta: Embedding) -> Tensor:
        """Score of each triple, for its head and its tail alike; shape (2, M, Q)."""
        return theta.score(*self.triples.unbind(-1)).expand(2, -1, -1)


def ahead(scores: Tensor, answer: Tensor, wrong: Tensor) -> Tensor:
    """Number of ``wrong`` candidates whose scores, (2, M, Q, C), exceed the answer's, (2, M, Q);
    a tie counts ½.
    """
    tie = TIE * torch.maximum(scores.abs().amax(-1), answer.abs())
    # NaN ties
    above, not_below = scores > (answer + tie)[..., None], ~(scores < (answer - tie)[..., None])
    return ((above & wrong).count_nonzero(dim=-1) + (not_below & wrong).count_nonzero(dim=-1)) / 2


def random_ranks(wrong: Tensor, queries: Queried) -> Tensor:
    """Expected reciprocal rank of each answer beside C - 1 ``wrong`` candidates:
    (1 + 1/2 + … + 1/C) / C.
    """
    number = (wrong.sum(-1) + 1)[:, queries.counted].double().flatten()
    return (torch.digamma(number + 1) + np.euler_gamma) / number


def queries_of(graph: Graph, ids: Tensor) -> Queried:
    """The queries of triples, ids (M, Q), padded with -1; every triple of the graph is right."""
    padded, right = (
        ids.clamp(min=0),
        torch.zeros(2, *ids.shape, len(graph.entities), dtype=torch.bool),
    )
    for slot, mask in zip((HEAD, TAIL), right, strict=True):
        alike = graph.same_but(slot, padded)
        mask.scatter_(
            -1, graph.triples[:, slot][torch.where(alike < 0, padded[..., None], alike)], True
        )
    return Queried(graph.triples[padded], ids >= 0, right)


@dataclass(frozen=True, eq=False)
class HiddenDraws:
    """M draws of n hidden known entities, and the triples that are
    queried after their insertion.
    """

    context: InitContext  #: its novel entities are the hidden ones
    about: Queried  #: triples of hidden entities, without their insert triples
    earlier: Queried  #: triples of the other entities
    share: float  #: number of new entities that ``h_cur`` is for, divided by n

    @cached_property
    def competes(self) -> Tensor:
        """Competitors of the answers of ``earlier`` before the insertion;
        shape (2, M, Q, E), bool.
        """
        hidden = membership(self.context.novel, self.context.known.shape[1])
        return ~(self.earlier.right | hidden[:, None])

    @cached_property
    def before(self) -> tuple[Tensor, Tensor]:
        """Scores and ranks of two answers of ``earlier`` before the insertion; shapes (2, 2, M, Q).

        The model was trained on the right answer. The second best wrong one stands for answers that
        were not trained on, whose ranks are not as safe.
        """
        theta0 = self.context.theta0
        scores, right = (
            self.earlier.scores(theta0, theta0.entity),
            self.earlier.right_scores(theta0),
        )
        plausible = (
            scores.masked_fill(~self.competes, -torch.inf)
            .topk(min(SECOND, scores.shape[-1]))
            .values[..., -1]
        )
        ranks = 1 + ahead(scores, right, self.competes), torch.full(right.shape, float(SECOND))
        return torch.stack([right, plausible]), torch.stack(ranks)

    @property
    def random_mrr(self) -> float:
        """Expected MRR of earlier triples if their ranks were random."""
        return random_ranks(self.competes, self.earlier).mean().item()

    def inserted(
        self, initializer: Registered, given: Mapping[str, Any]
    ) -> tuple[dict[str, Any], Tensor] | None:
        """The checked options, and the vectors of the hidden entities, (M, n, d);
        None if not all are finite.
        """
        try:
            options = options_of(initializer.name, given, "initializer")
            return options, initializer.initialize(self.context, options).vectors
        except (InputError, NoRelationMap):
            return None

    def theta(self, vectors: Tensor) -> Embedding:
        """The embedding with vectors of the hidden entities, (M, n, d)."""
        theta0, places = self.context.theta0, self.context.novel[..., None].expand_as(vectors)
        return replace(theta0, entity=theta0.entity.scatter(1, places, vectors))

    def measure(self, initializer: Registered, given: Mapping[str, Any]) -> Candidate | None:
        """Insert the hidden entities and measure; None if the initializer has
        no finite vectors for them.
        """
        if (inserted := self.inserted(initializer, given)) is None:
            return None
        (options, vectors), novel = inserted, self.context.novel
        theta = self.theta(vectors)
        about = self.about.scores(theta, theta.entity)
        ranks = 1 + ahead(about, self.about.right_scores(theta), ~self.about.right)
        is_hidden = (self.about.answers[..., None] == novel[:, None]).any(-1)
        places = novel[:, None].expand(*self.earlier.right.shape[:3], -1)
        (answers, before), scores = self.before, self.earlier.scores(theta, vectors)
        wrong = ~self.earlier.right.gather(-1, places)
        after = before + self.share * torch.stack(
            [ahead(scores, answer, wrong) for answer in answers]
        )
        known_ends, hidden_ends, h_old, h_cur = (
            (1 / part).double().mean().item()
            for part in (
                ranks[self.about.counted & ~is_hidden],
                ranks[self.about.counted & is_hidden],
                before[0][:, self.earlier.counted],
                after[0][:, self.earlier.counted],
            )
        )
        loss = (1 / before - 1 / after).double()[..., self.earlier.counted].mean().item()
        return Candidate(initializer.name, options, known_ends, hidden_ends, h_old, h_cur, loss)


def hide(
    theta0: Embedding,
    triples: np.ndarray,
    numbers: np.ndarray,
    words: np.ndarray | None,
    kinds: np.ndarray | None,
    seed: int,
    most: int,
) -> HiddenDraws | None:
    """Draw at most ``most`` hidden entities, a tenth of the known ones at a time;
    None with too few triples to query.

    Entities with more triples than the median new one come first, at random. In each draw, the
    better connected hidden entities get the larger ``numbers`` of insert triples, if they have
    them.
    """
    rng, known = stream(seed, "hidden known entities"), theta0.entity.shape[1]
    ends = triples[:, [HEAD, TAIL]]
    degree = np.bincount(ends[ends[:, 0] != ends[:, 1]].flatten(), minlength=known)
    order = np.lexsort((rng.random(known), -np.minimum(degree, np.median(numbers) + 1)))
    suitable = degree >= min(2, 1 + numbers.max())
    order = order[(suitable if words is None else suitable & words.any(1))[order]]
    tenth = max(1, known // ONE_IN)
    together = min(tenth, most // -(-most // tenth))
    draws = min(most, len(order)) // together
    each = min(QUERIES * together, MOST_SCORES // known // max(1, draws))
    inserted, about, earlier = list[tuple[int, int, int]](), list[list[int]](), list[list[int]]()
    novel = order[: draws * together].reshape(draws, together)
    for draw, hidden in enumerate(novel):
        hidden[:] = hidden[np.argsort(-degree[hidden], kind="stable")]
        given, touching = (
            np.sort(np.resize(rng.permutation(numbers), together))[::-1],
            np.isin(ends, hidden).sum(1),
        )
        held_out = list[tuple[int, int]]()
        for place, entity in enumerate(hidden):
            of_entity = rng.permutation(np.flatnonzero((ends == entity).any(1) & (touching == 1)))
            count = min(given[place], len(of_entity) - -(-len(of_entity) // KEPT_BACK))
            inserted += [(draw, place, triple) for triple in np.sort(of_entity[:count])]
            held_out += enumerate(of_entity[count:].tolist())
        about.append(
            [triple for _, triple in sorted(held_out, key=itemgetter(0))[:each]]
        )  # the first of each entity, ...
        earlier.append(rng.permutation(np.flatnonzero(touching == 0))[:each].tolist())
    if sum(map(len, about)) < LEAST_QUERIES or sum(map(len, earlier)) < LEAST_QUERIES:
        return None
    graph, ids = trained_session(triples, theta0, kinds).graph, torch.from_numpy(novel)
    mask = membership(ids, known)
    session = Session(graph, ~mask, touches(graph, mask).to(torch.int8) * (OUT - TRAIN) + TRAIN)
    tables = theta0.entity * ~mask[..., None], theta0.relation.repeat(draws, 1, 1)
    vectors = torch.zeros(known, 1) if words is None else torch.from_numpy(words)
    context = context_of(
        Embedding(*tables, theta0.model),
        session,
        ids,
        torch.tensor(inserted, dtype=torch.int64).view(-1, 3),
        vectors,
        seed,
        torch.arange(draws)[:, None],
    )
    context = replace(context, by_kind=kinds is not None)
    share = max(tenth, len(numbers)) / together
    return HiddenDraws(
        context, queries_of(graph, padded(about)), queries_of(graph, padded(earlier)), share
    )


def padded(listed: list[list[int]]) -> Tensor:
    """Lists of ids as a table, padded with -1 to the longest."""
    rows = [torch.tensor(ids, dtype=torch.int64) for ids in listed]
    return pad_sequence(rows, batch_first=True, padding_value=-1)
