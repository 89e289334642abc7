"""The right answers to queries about a head or a tail, and the snapshots in which they arrive."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from isi.continual.timeline import SPLITS, Split, Timeline
from isi.graph.graph import HEAD, RELATION, TAIL

#: What LKGE's code reads. It takes test.txt for validation, too, and never reads valid.txt
#: (nju-websoft/LKGE at 5a74dae, src/data_load/KnowledgeGraph.py:27).
READ_BY_LKGE: tuple[Split, ...] = ("train", "test")
ENDS = {"head": HEAD, "tail": TAIL}  #: The slots of a triple that queries hide.


@dataclass(frozen=True, eq=False)
class TrueAnswers:
    """The N unique triples of a timeline, sorted by the query that hides one slot of them."""

    slot: int
    relations: int
    query: np.ndarray  #: numbers of the queries, ascending; shape (N,)
    answer: np.ndarray  #: ids of entities; shape (N,)
    arrival: np.ndarray  #: first snapshot that has the triple; shape (N,)
    #: first snapshot that has it in the splits that LKGE's code reads; their number T: none has
    arrival_in_lkge: np.ndarray

    def of(self, triples: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The right answers to the queries that hide the slot of ``triples``, (Q, 3): for each
        pair of a query and an answer, the row of the query and the place in N; shapes (P,).
        """
        first, number = self._range(triples)
        row = np.repeat(np.arange(len(triples)), number)
        start = np.cumsum(number) - number
        place = np.arange(len(row)) - start[row] + first[row]
        return row, place

    def number(self, triples: np.ndarray) -> np.ndarray:
        """Number of right answers to each query; shape (Q,)."""
        return self._range(triples)[1]

    def part(self, chosen: np.ndarray) -> TrueAnswers:
        """The answers in a mask, (N,), alone."""
        columns = self.query, self.answer, self.arrival, self.arrival_in_lkge
        return TrueAnswers(self.slot, self.relations, *(column[chosen] for column in columns))

    def _range(self, triples: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """First place and number of the answers to each query; shapes (Q,)."""
        query = query_of(triples, self.slot, self.relations)
        first = np.searchsorted(self.query, query)
        return first, np.searchsorted(self.query, query, "right") - first


def query_of(triples: np.ndarray, slot: int, relations: int) -> np.ndarray:
    """A number for each pair of the given end and relation of triples, (N, 3); shape (N,)."""
    given_end = HEAD + TAIL - slot
    numbers: np.ndarray = triples[:, given_end] * relations + triples[:, RELATION]
    return numbers


def true_answers(timeline: Timeline, slot: int) -> TrueAnswers:
    """The answers in all snapshots and splits to the queries that hide a slot, HEAD or TAIL."""
    parts = [
        (snapshot.split(split), number, split)
        for number, snapshot in enumerate(timeline.snapshots)
        for split in SPLITS
    ]
    lengths = [len(triples) for triples, _, _ in parts]
    arrivals = np.repeat([number for _, number, _ in parts], lengths)
    is_read = np.repeat([split in READ_BY_LKGE for _, _, split in parts], lengths)
    together = np.concatenate([triples for triples, _, _ in parts])
    relations = len(timeline.relation_names)
    query, answer = query_of(together, slot, relations), together[:, slot]
    # ascending by query, then by answer
    _, first, triple = np.unique(
        query * len(timeline.entity_names) + answer, return_index=True, return_inverse=True
    )
    never = len(timeline.snapshots)
    arrival, arrival_in_lkge = np.full((2, len(first)), never)
    np.minimum.at(arrival, triple, arrivals)
    np.minimum.at(arrival_in_lkge, triple[is_read], arrivals[is_read])
    return TrueAnswers(slot, relations, query[first], answer[first], arrival, arrival_in_lkge)
