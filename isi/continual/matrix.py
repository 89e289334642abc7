"""R[i, j]: ranks of the test set of snapshot j by the embedding of snapshot i, under all protocols.

Published protocols differ in the candidates and in the facts that are no errors. Here one table of
scores per test set gives the ranks of all of them, so that a difference between two protocols is
one of candidates and filters alone.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np
import torch
from torch import Tensor

from isi.config import Count, check
from isi.continual.answers import ENDS, TrueAnswers, true_answers
from isi.continual.timeline import Timeline
from isi.errors import InputError
from isi.evaluation.ranks import parts, scores_of, wins
from isi.models.stack import Embedding, usual_torch
from isi.random import stream

if TYPE_CHECKING:
    import pandas as pd

#: Whether the vectors of snapshot i's new entities were inserted, or then trained on its triples.
Phase = Literal["inserted", "trained"]
#: A snapshot: that of the test set (j), that of the embedding (i), or the one before it (i - 1).
Of = Literal["test", "embedding", "before"]
HITS = (1, 3, 10)  #: Ranks of hits@k.
MEASURES = ("mrr", *(f"hits@{k}" for k in HITS))
#: The mean of the reciprocal rank of a query times the mean of both of its triple. Over both slots,
#: it is the mean square of the triples' means, which tells the error of a sample of triples.
SQUARE = "mrr_square"
QUERIES = ["phase", "i", "j", "slot", "answer"]  #: Columns by which ``measure`` groups queries.
TRIPLE_OF = ["i", "j", "head", "relation", "tail"]  #: Columns that name the triple of a query.


@dataclass(frozen=True)
class Protocol:
    """Which entities may answer a query, and which facts are no errors."""

    candidates: Of  #: the entities known after this snapshot
    filter: Of  #: the facts known after this snapshot
    without_valid: bool = False  #: whether the filter lacks validation triples


#: By name, who evaluates so. ``lkge``: the code of LKGE, which never reads valid.txt; ``incde``:
#: IncDE, FastKGE and ETT-CKGE; ``revisiting``: RevisitingCKGE's correction; ``current``: MEOR's
#: H_cur and A_TN, and the scope ``known`` of the experiments; ``old``: MEOR's H_old, for earlier
#: test sets only, and the scope ``known_closed``.
PROTOCOLS = {
    "lkge": Protocol("test", "test", without_valid=True),
    "incde": Protocol("test", "test"),
    "revisiting": Protocol("embedding", "test"),
    "current": Protocol("embedding", "embedding"),
    "old": Protocol("before", "embedding"),
}


def evaluate(
    theta: Embedding,
    timeline: Timeline,
    i: int,
    *,
    phase: Phase = "trained",
    tests: Sequence[int] | None = None,
    most: int | None = None,
    protocols: Sequence[str] = tuple(PROTOCOLS),
) -> pd.DataFrame:
    """Row i of R: measures of the test sets by the embedding of snapshot i.

    Args and errors are those of ``query_ranks``. Frames of several snapshots and phases, joined by
    ``pandas.concat``, are the input of ``isi.continual.measures``; ``pooled`` gives R[i, j].

    Returns:
        the columns ``phase``, ``protocol``, ``i``, ``j``, ``slot`` (head or tail), ``answer`` (new:
        it arrived with snapshot i; else old), ``queries``, ``mrr``, ``SQUARE`` and ``hits@k``.

    Example:
        >>> import torch
        >>> from isi.continual import Timeline, evaluate
        >>> from isi.continual.matrix import pooled
        >>> from isi.models.bilinear import DistMult
        >>> from isi.models.stack import Embedding
        >>> first = [("cup", "in", "hall")], [], [("cup", "in", "den")]
        >>> second = [("mug", "in", "hall")], [], [("mug", "in", "den")]
        >>> grown = Timeline.of([first, second])
        >>> theta = Embedding(torch.ones(1, 4, 2), torch.ones(1, 1, 2), DistMult())
        >>> pooled(evaluate(theta, grown, 1, protocols=["incde", "current"]))
             phase protocol  i  j  queries       mrr  hits@1  hits@3  hits@10
        0  trained  current  1  0        2  0.500000     0.0     1.0      1.0
        1  trained  current  1  1        2  0.500000     0.0     1.0      1.0
        2  trained    incde  1  0        2  0.583333     0.0     1.0      1.0
        3  trained    incde  1  1        2  0.500000     0.0     1.0      1.0
    """
    ranks = query_ranks(
        theta, timeline, i, phase=phase, tests=tests, most=most, protocols=protocols
    )
    return measure(ranks, protocols)


@usual_torch()
def query_ranks(
    theta: Embedding,
    timeline: Timeline,
    i: int,
    *,
    phase: Phase = "trained",
    tests: Sequence[int] | None = None,
    most: int | None = None,
    protocols: Sequence[str] = tuple(PROTOCOLS),
) -> pd.DataFrame:
    """Filtered ranks of the heads and tails of test sets by the embedding of snapshot i.

    A tie counts ½; it is within ``TIE`` of the largest score of the query among all entities of
    snapshot i.

    Args:
        theta: a stack of one embedding; its first rows are the entities and relations known after
            snapshot i, in the order of ids, and further ones are ignored.
        phase: says in the result whether theta has been trained on snapshot i.
        tests: snapshots of the test sets, at most i; None: 0 to i.
        most: maximum number of triples of a test set; of a larger one, a random sample is ranked,
            the same in each call.
        protocols: names in ``PROTOCOLS``.

    Returns:
        a row for each query: ``QUERIES``; ``head``, ``relation`` and ``tail``, ids; and by protocol
        the rank, NaN where the protocol does not rank the query.

    Raises:
        InputError: names the wrong argument.

    Example:
        >>> import torch
        >>> from isi.continual import Timeline, query_ranks
        >>> from isi.models.bilinear import DistMult
        >>> from isi.models.stack import Embedding
        >>> first = [("cup", "in", "hall")], [], [("cup", "in", "den")]
        >>> grown = Timeline.of([first, ([("mug", "in", "den")], [], [])])
        >>> theta = Embedding(torch.ones(1, 4, 2), torch.ones(1, 1, 2), DistMult())
        >>> ranks = query_ranks(theta, grown, 1, protocols=["incde", "revisiting", "current"])
        >>> ranks[["slot", "head", "tail", "incde", "revisiting", "current"]]
           slot  head  tail  incde  revisiting  current
        0  head     0     2    2.0         2.5      2.0
        1  tail     0     2    1.5         2.0      2.0
    """
    import pandas as pd

    most = check(most, Count | None, "", "argument 'most'")  # type: ignore[arg-type]
    tests = range(i + 1) if tests is None else tests
    theta = _checked(theta, timeline, i, tests, protocols)
    in_all = [true_answers(timeline, slot) for slot in ENDS.values()]
    answers = [known.part(known.arrival <= i) for known in in_all]
    old = timeline.entities[i - 1] if i else 0
    frames = []
    for j in tests:
        triples = _sample(timeline.snapshots[j].test, most, j)
        by_protocol = {name: _limits(timeline, PROTOCOLS[name], i, j) for name in protocols}
        ranks = _ranks(theta, triples, answers, list(by_protocol.values()))
        for (name, slot), of_slot in zip(ENDS.items(), ranks, strict=True):
            ids = dict(zip(("head", "relation", "tail"), triples.T, strict=True))
            kind = np.where(triples[:, slot] < old, "old", "new")
            columns = {"phase": phase, "i": i, "j": j, "slot": name, "answer": kind, **ids}
            frames.append(pd.DataFrame(columns | dict(zip(by_protocol, of_slot, strict=True))))
    return pd.concat(frames, ignore_index=True)


def _sample(triples: np.ndarray, most: int | None, j: int) -> np.ndarray:
    """At most ``most`` of the triples of test set j, (N, 3), in their order."""
    if most is None or len(triples) <= most:
        return triples
    order = stream(0, "test triples of a snapshot", j).permutation(len(triples))
    sample: np.ndarray = triples[np.sort(order[:most])]
    return sample


def measure(ranks: pd.DataFrame, protocols: Iterable[str]) -> pd.DataFrame:
    """The measures of ``query_ranks`` by protocol and ``QUERIES``: the result of ``evaluate``."""
    import pandas as pd

    frames = []
    for name in protocols:
        of_protocol = ranks.dropna(subset=name)
        rank = of_protocol[name]
        values = of_protocol[QUERIES].assign(protocol=name, queries=1, mrr=1 / rank)
        triples = [of_protocol[column] for column in TRIPLE_OF]
        values[SQUARE] = values["mrr"] * values["mrr"].groupby(triples).transform("mean")
        for k in HITS:
            values[f"hits@{k}"] = (rank <= k).astype(float)
        frames.append(values)
    rows = pd.concat(frames, ignore_index=True)
    return _means(rows, ["phase", "protocol", *QUERIES[1:]], ["mrr", SQUARE, *MEASURES[1:]])


def pooled(
    frame: pd.DataFrame, by: Sequence[str] = ("phase", "protocol", "i", "j")
) -> pd.DataFrame:
    """The measures of ``evaluate`` over all queries that agree in the columns ``by``; without
    others, R[i, j] for each phase and protocol.

    Example:
        >>> import pandas as pd
        >>> from isi.continual import pooled
        >>> rows = {"phase": "trained", "protocol": "current", "i": 0, "j": 0}
        >>> values = dict.fromkeys(["mrr", "hits@1", "hits@3", "hits@10"], [1.0, 0.5])
        >>> frame = pd.DataFrame({**rows, "slot": ["head", "tail"], "queries": [3, 1], **values})
        >>> pooled(frame)
             phase protocol  i  j  queries    mrr  hits@1  hits@3  hits@10
        0  trained  current  0  0        4  0.875   0.875   0.875    0.875
    """
    return _means(frame, list(by), list(MEASURES))


def _means(frame: pd.DataFrame, by: list[str], measures: list[str]) -> pd.DataFrame:
    """Means of measures by groups, weighted by the numbers of queries."""
    weighted = frame[measures].mul(frame["queries"], axis=0)
    sums = frame[[*by, "queries"]].join(weighted).groupby(by).sum()
    sums[measures] = sums[measures].div(sums["queries"], axis=0)
    return sums.reset_index()


@dataclass(frozen=True)
class _Limits:
    """A protocol for the pair (i, j)."""

    candidates: int  #: their ids are below this; 0: no query is ranked
    filter: int  #: facts of snapshots up to this are no errors
    without_valid: bool

    def filtered(self, known: TrueAnswers, place: np.ndarray) -> np.ndarray:
        """Whether each right answer, at ``place`` of ``known``, is a candidate and no error."""
        arrival = known.arrival_in_lkge if self.without_valid else known.arrival
        is_candidate = known.answer[place] < self.candidates
        is_filtered: np.ndarray = is_candidate & (arrival[place] <= self.filter)
        return is_filtered


def _limits(timeline: Timeline, protocol: Protocol, i: int, j: int) -> _Limits:
    snapshot = {"test": j, "embedding": i, "before": i - 1}
    last = snapshot[protocol.candidates]
    # before snapshot j, its answers may be no candidates
    candidates = timeline.entities[last] if last >= j else 0
    return _Limits(int(candidates), snapshot[protocol.filter], protocol.without_valid)


def _ranks(
    theta: Embedding, triples: np.ndarray, answers: Sequence[TrueAnswers], limits: list[_Limits]
) -> np.ndarray:
    """Ranks of the heads, then of the tails, of triples, (Q, 3), for L limits; shape (2, L, Q)."""
    ranks = []
    for part in parts(torch.from_numpy(triples), 2 * theta.entity.shape[1]):
        by_slot = [
            _slot_ranks(of_slot, part, known, limits)
            for known, of_slot in zip(answers, _scores(theta, part), strict=True)
        ]
        ranks.append(np.stack(by_slot))
    return np.concatenate(ranks, axis=-1)


@torch.no_grad()
def _scores(theta: Embedding, triples: Tensor) -> tuple[Tensor, Tensor]:
    """Scores of all entities as heads, then as tails, of triples, (Q, 3); shapes (Q, E)."""
    head, relation, tail = triples.T[:, None].to(theta.entity.device)
    as_heads, as_tails = theta.score_heads(relation, tail), theta.score_tails(head, relation)
    return as_heads[0].cpu(), as_tails[0].cpu()


def _slot_ranks(
    scores: Tensor, triples: Tensor, known: TrueAnswers, limits: list[_Limits]
) -> np.ndarray:
    """Ranks of one slot of triples, (Q, 3), among scores, (Q, E), for L limits; shape (L, Q)."""
    won = wins(scores, scores_of(triples[:, known.slot], scores)).numpy()
    row, place = known.of(triples.numpy())
    won_by_right = won[row, known.answer[place]]
    ranks = np.full((len(limits), len(triples)), np.nan)
    for limit, of_limit in zip(limits, ranks, strict=True):
        if limit.candidates:
            # the queried triple, too, is in each filter: its answer is tied with itself
            # NumPy counts 9 times faster than torch
            ahead = won[:, : limit.candidates].sum(1, dtype=int)
            left_out = limit.filtered(known, place)
            no_errors = np.bincount(row, won_by_right * left_out, len(triples))
            of_limit[:] = 1 + (ahead - no_errors) / 2
    return ranks


def _checked(
    theta: Embedding, timeline: Timeline, i: int, tests: Sequence[int], protocols: Sequence[str]
) -> Embedding:
    """The embedding with the rows of snapshot i alone; InputError names a wrong argument."""
    number = len(timeline.snapshots)
    if not 0 <= i < number:
        raise InputError("argument 'i'", "", f"expected a snapshot from 0 to {number - 1}, got {i}")
    for j in tests:
        if not 0 <= j <= i:
            raise InputError("argument 'tests'", "", f"expected snapshots from 0 to {i}, got {j}")
    for name in protocols:
        if name not in PROTOCOLS:
            expected = f"expected names of {', '.join(PROTOCOLS)}, got {name!r:.80}"
            raise InputError("argument 'protocols'", "", expected)
    entities, relations = int(timeline.entities[i]), int(timeline.relations[i])
    least = (1, entities), (1, relations)
    got = tuple(theta.entity.shape[:2]), tuple(theta.relation.shape[:2])
    for kind, expected_shape, shape in zip(("entities", "relations"), least, got, strict=True):
        if shape[0] != 1 or shape[1] < expected_shape[1]:
            expected = f"expected a stack of one with {expected_shape[1]} {kind} or more"
            raise InputError("argument 'theta'", "", f"{expected}, got the shape {shape}")
    return Embedding(theta.entity[:, :entities], theta.relation[:, :relations], theta.model)
