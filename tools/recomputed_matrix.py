"""R[i, j] of graphs that grow, and what the report shows of it, computed from the third pipeline's
tables as docs/insert_reference.md and docs/continual.md define them.

A second, simple implementation, which uses no code of the library; for ComplEx alone, and for the
chains whose new vectors are the mean of the known ones.
"""

from __future__ import annotations

import zlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
from safetensors.numpy import load_file

#: Two scores are tied if they differ by at most ``TIE`` of the query's largest |score|. A
#: difference within ``ROUNDING`` of that limit may be either: the library's numbers are float32.
TIE, ROUNDING = 1e-5, 1e-6
QUERIES_AT_ONCE = 500  #: Rows of one table of scores.
HEAD, RELATION, TAIL = range(3)
ENDS = {"head": HEAD, "tail": TAIL}
HITS = (1, 3, 10)
MEASURES = ("mrr", *(f"hits@{k}" for k in HITS))
SPLITS = ("train", "valid", "test")
READ_BY_LKGE = ("train", "test")
PROTOCOLS = ("lkge", "incde", "revisiting", "current", "old")
#: By benchmark, its column in data/raw/snapshots/triples.parquet.
COLUMNS = {
    "ENTITY": "lkge_entity",
    "RELATION": "lkge_relation",
    "FACT": "lkge_fact",
    "HYBRID": "lkge_hybrid",
    "GraphEqual": "graph_equal",
    "GraphHigher": "graph_higher",
    "GraphLower": "graph_lower",
    "FBinc-S": "fbinc_s",
    "FBinc-M": "fbinc_m",
    "FBinc-L": "fbinc_l",
}
ABSENT = 255  #: In such a column: the triple takes no part.

#: Of a row of ``matrix.parquet``: protocol, test set j, slot, kind of answer.
Group = tuple[str, int, str, str]
#: Of a part of a chain: initializer and strategy (both None: the first embedding), phase, i.
Step = tuple[str | None, str | None, str, int]
Settings = Mapping[str, Any]  #: An entry of ``continual`` in continual/params.yaml.


def chains_of(settings: Settings) -> list[tuple[str, str]]:
    """Initializers with their strategies, in the order of params."""
    pairs, chains = settings["pairs"], []
    for initializer in settings["initializers"]:
        strategies = pairs if pairs == "all" else pairs.get(initializer, [])
        if strategies == "all":
            strategies = list(settings["strategies"])
        chains += [(initializer, strategy) for strategy in strategies]
    return chains


def plain_steps(settings: Settings, last: int) -> list[Step]:
    """The parts of chains whose new vectors are the mean of the known ones, up to a ``last``
    snapshot. Whatever trains later, those of snapshot 1 are.
    """
    steps: list[Step] = [(None, None, "trained", 0)]
    strategies = [strategy for name, strategy in chains_of(settings) if name == "mean"]
    for strategy in strategies:
        steps.append(("mean", strategy, "inserted", 1))
        if strategy == "insert":
            steps.append(("mean", strategy, "trained", 1))
            for i in range(2, last + 1):
                steps += [("mean", strategy, phase, i) for phase in ("inserted", "trained")]
    return steps


# The graph and its queries


class GrowingGraph:
    """The triples of a timeline, with ids in the order of first appearance."""

    def __init__(self, timeline: str) -> None:
        ids: dict[Any, int] = {}
        relations: dict[Any, int] = {}
        self.entities: list[int] = []  #: number of those known after each snapshot
        self.relations: list[int] = []
        self.tests: list[np.ndarray] = []  #: shapes (N, 3)
        #: by slot, given end and relation: the right answers
        self.answers: dict[tuple[int, int, int], dict[int, Answer]] = {}
        for snapshot, splits in enumerate(splits_of(timeline)):
            for split, named in zip(SPLITS, splits, strict=True):
                triples = []
                for head, relation, tail in named:
                    first = ids.setdefault(head, len(ids))
                    second = ids.setdefault(tail, len(ids))
                    triples.append((first, relations.setdefault(relation, len(relations)), second))
                for triple in triples:
                    self._add(triple, snapshot, split)
                if split == "test":
                    self.tests.append(np.array(triples, int).reshape(-1, 3))
            self.entities.append(len(ids))
            self.relations.append(len(relations))

    def _add(self, triple: tuple[int, int, int], snapshot: int, split: str) -> None:
        for slot in ENDS.values():
            query = slot, triple[HEAD + TAIL - slot], triple[RELATION]
            answer = self.answers.setdefault(query, {}).setdefault(triple[slot], Answer())
            answer.arrival = min(answer.arrival, snapshot)
            if split in READ_BY_LKGE:
                answer.in_lkge = min(answer.in_lkge, snapshot)

    @property
    def last(self) -> int:
        return len(self.tests) - 1

    def ranked(self, j: int, most: int | None) -> np.ndarray:
        """The triples of test set j that are ranked, shape (Q, 3): at most ``most``, by a random
        stream whose seed is 0, a purpose and j.
        """
        triples = self.tests[j]
        if most is None or len(triples) <= most:
            return triples
        purpose = zlib.crc32(b"test triples of a snapshot")
        order = np.random.default_rng(np.random.SeedSequence([0, purpose, j]))
        drawn: np.ndarray = triples[np.sort(order.permutation(len(triples))[:most])]
        return drawn


@dataclass
class Answer:
    """The first snapshots that have a fact: in any split, and in those that LKGE's code reads."""

    arrival: float = np.inf
    in_lkge: float = np.inf


def splits_of(timeline: str) -> Iterator[list[list[tuple[Any, Any, Any]]]]:
    """The triples of each snapshot, by ``SPLITS``: of a benchmark, or of a folder as LKGE writes
    it.
    """
    if timeline not in COLUMNS:
        for snapshot in range(len(list(Path(timeline).iterdir()))):
            files = [Path(timeline, str(snapshot), f"{split}.txt") for split in SPLITS]
            yield [lines_of(file) for file in files]
        return
    column = COLUMNS[timeline]
    path = Path("data/raw/snapshots/triples.parquet")
    table = pq.read_table(path, columns=["head", "relation", "tail", column])
    head, relation, tail, place = (np.asarray(table[name]) for name in table.column_names)
    last = place[place != ABSENT].max()
    for first in range(0, last + 1, len(SPLITS)):
        rows = [np.flatnonzero(place == first + split) for split in range(len(SPLITS))]
        yield [
            list(zip(head[chosen], relation[chosen], tail[chosen], strict=True)) for chosen in rows
        ]


def lines_of(file: Path) -> list[tuple[Any, Any, Any]]:
    """Triples of names, with tabs between them."""
    lines = file.read_text(encoding="utf-8").splitlines()
    return [(head, relation, tail) for head, relation, tail in (line.split("\t") for line in lines)]


def limits_of(protocol: str, i: int, j: int) -> tuple[int, int]:
    """The snapshots whose entities are candidates, and whose facts are no errors."""
    return {
        "lkge": (j, j),
        "incde": (j, j),
        "revisiting": (i, j),
        "current": (i, i),
        "old": (i - 1, i),
    }[protocol]


# Ranks


class FirstEmbedding:
    """The first embedding of a seed, by which R is computed."""

    def __init__(self, entity: np.ndarray, relation: np.ndarray) -> None:
        """Tables of entities, (E, d), and of relations with their inverse ones, (R, 2d)."""
        self.entity = as_complex(entity)  #: (E, d / 2)
        forward, inverse = np.split(relation, 2, axis=1)
        #: by the slot that a query hides; shapes (R, d / 2)
        self.relation = {TAIL: as_complex(forward), HEAD: as_complex(inverse)}

    @classmethod
    def read(cls, experiment: str) -> list[FirstEmbedding]:
        """Those of an experiment, by seed."""
        tables = load_file(f"data/continual/{experiment}/first.safetensors")
        return [cls(*rows) for rows in zip(tables["entity"], tables["relation"], strict=True)]

    def with_means(self, entities: int) -> np.ndarray:
        """The vectors of so many entities: those after the first snapshot have the mean of the
        others. (With them, the mean of all stays the same.)
        """
        new = entities - len(self.entity)
        return np.concatenate([self.entity, np.tile(self.entity.mean(0), (new, 1))])

    def matrix_row(
        self, graph: GrowingGraph, i: int, most: int | None
    ) -> dict[Group, tuple[np.ndarray, np.ndarray]]:
        """Lower and upper bounds of the number of queries and ``MEASURES``, by group, of the test
        sets 0 to i whose relations all have a row; shapes (5,).
        """
        vectors = self.with_means(graph.entities[i])
        row = {}
        for j in range(i + 1):
            triples = graph.ranked(j, most)
            if not self.can_rank(triples):
                continue
            for name, slot in ENDS.items():
                ranks = self._ranks(graph, vectors, triples, i, j, slot)
                is_new = triples[:, slot] >= (graph.entities[i - 1] if i else 0)
                for kind, chosen in (("new", is_new), ("old", ~is_new)):
                    for protocol, (lowest, highest) in ranks.items():
                        if chosen.any():
                            bounds = measures(highest[chosen]), measures(lowest[chosen])
                            row[protocol, j, name, kind] = bounds
        return row

    def can_rank(self, triples: np.ndarray) -> bool:
        """Whether all relations of triples, (N, 3), are those of the first snapshot: a later one
        is fitted.
        """
        return bool((triples[:, RELATION] < len(self.relation[TAIL])).all())

    def _ranks(
        self,
        graph: GrowingGraph,
        vectors: np.ndarray,
        triples: np.ndarray,
        i: int,
        j: int,
        slot: int,
    ) -> dict[str, np.ndarray]:
        """The lowest and the highest possible rank of the hidden ends of triples, (Q, 3), by
        protocol; shapes (2, Q).
        """
        parts = []
        for start in range(0, len(triples), QUERIES_AT_ONCE):
            part = triples[start : start + QUERIES_AT_ONCE]
            given, relation, answer = part[:, HEAD + TAIL - slot], part[:, RELATION], part[:, slot]
            mapped = vectors[given] * self.relation[slot][relation]
            scores = (mapped @ vectors.conj().T).real
            known = [
                graph.answers[slot, *query]
                for query in zip(given.tolist(), relation.tolist(), strict=True)
            ]
            wins = wins_of(scores, answer)
            parts.append(ranks_of(wins, known, graph.entities, i, j))
        return {
            protocol: np.concatenate([part[protocol] for part in parts], axis=1)
            for protocol in (parts[0] if parts else ())
        }


def as_complex(table: np.ndarray) -> np.ndarray:
    """Rows of real halves and imaginary halves, (N, d), as complex numbers, (N, d / 2)."""
    real, imaginary = np.split(table.astype(float), 2, axis=1)
    return real + 1j * imaginary


def wins_of(scores: np.ndarray, answer: np.ndarray) -> np.ndarray:
    """By how much each candidate of scores, (Q, E), counts as ahead of its query's answer, (Q,):
    1, or ½ in a tie. At least and at most, as scores are rounded; shape (2, Q, E).
    """
    gap = scores - scores[np.arange(len(scores)), answer][:, None]
    largest = np.abs(scores).max(1, keepdims=True)
    wins = []
    for slack in (ROUNDING, -ROUNDING):
        is_above = gap > (TIE + slack) * largest
        is_not_below = gap >= (-TIE + slack) * largest
        wins.append((is_above + 1.0 * is_not_below) / 2)
    return np.stack(wins)


def ranks_of(
    wins: np.ndarray, known: list[dict[int, Answer]], entities: list[int], i: int, j: int
) -> dict[str, np.ndarray]:
    """Ranks by protocol, (2, Q), from ``wins_of``, (2, Q, E), and the right answers of each query.

    The answer, too, is a right answer. It is tied with itself, and so does not count.
    """
    query = np.repeat(np.arange(len(known)), [len(answers) for answers in known])
    answer = np.array([entity for answers in known for entity in answers], int)
    right = [place for answers in known for place in answers.values()]
    arrival = np.array([place.arrival for place in right])
    in_lkge = np.array([place.in_lkge for place in right])
    ranks = {}
    for protocol in PROTOCOLS:
        candidates, facts = limits_of(protocol, i, j)
        if candidates < j:  # the answer may be no candidate
            continue
        number = entities[candidates]
        no_error = (in_lkge if protocol == "lkge" else arrival) <= facts
        no_error &= answer < number
        left_out = wins[:, query[no_error], answer[no_error]]
        ahead = wins[:, :, :number].sum(2)
        for bound, of_answers in zip(ahead, left_out, strict=True):
            bound -= np.bincount(query[no_error], of_answers, len(known))
        ranks[protocol] = 1 + ahead
    return ranks


def measures(ranks: np.ndarray) -> np.ndarray:
    """The number of queries and ``MEASURES`` of ranks, (Q,); shape (5,)."""
    hits = [(ranks <= k).mean() for k in HITS]
    return np.array([len(ranks), (1 / ranks).mean(), *hits])


# Tables


class MatrixTable:
    """Rows of ``matrix.parquet``: an array for each column."""

    def __init__(self, columns: Mapping[str, np.ndarray]) -> None:
        self.columns = columns

    @classmethod
    def read(cls, experiment: str) -> MatrixTable:
        table = pq.read_table(f"data/continual/{experiment}/matrix.parquet")
        names = table.column_names
        return cls({name: np.asarray(table[name].to_pandas()) for name in names})

    def chosen(self, mask: np.ndarray) -> MatrixTable:
        """The rows of a mask."""
        return MatrixTable({name: values[mask] for name, values in self.columns.items()})

    def where(self, **values: Any) -> MatrixTable:
        """The rows with these values in their columns."""
        masks = [self.columns[name] == value for name, value in values.items()]
        return self.chosen(np.logical_and.reduce(masks))

    def chain(self, initializer: str, strategy: str, seed: int) -> MatrixTable:
        """The rows of a chain, with those of its first embedding."""
        columns = self.columns
        is_chain = (columns["initializer"] == initializer) & (columns["strategy"] == strategy)
        is_first = columns["i"] == 0
        return self.chosen((columns["seed"] == seed) & (is_chain | is_first))

    def step(self, step: Step, seed: int) -> dict[Group, np.ndarray]:
        """The numbers of queries and ``MEASURES`` of a part of a chain; shapes (5,)."""
        initializer, strategy, phase, i = step
        rows = self.where(seed=seed, phase=phase, i=i)
        if initializer is not None:
            rows = rows.where(initializer=initializer, strategy=strategy)
        groups = zip(
            *(rows.columns[name].tolist() for name in ("protocol", "j", "slot", "answer")),
            strict=True,
        )
        numbers = np.stack([rows.columns[name] for name in ("queries", *MEASURES)], 1)
        return dict(zip(groups, numbers.astype(float), strict=True))

    @property
    def last(self) -> int:
        """The last snapshot i."""
        return int(self.columns["i"].max())

    def mean(self, measure: str = "mrr") -> float:
        """Of a measure over all queries; NaN without any."""
        queries = self.columns["queries"]
        weighted = (queries * self.columns[measure]).sum()
        return float(weighted / queries.sum()) if len(queries) else np.nan


# What the report shows of a chain, from its rows of ``matrix.parquet``; per cent


def published(rows: MatrixTable, table: str, line: Mapping[str, str]) -> dict[str, float]:
    """The numbers of a line of a table, by column."""
    if table == "grown":
        return grown(rows)
    return after_last(rows, line["protocol"]) if table == "after_last" else interference(rows)


def grown(rows: MatrixTable) -> dict[str, float]:
    """MRR of new tests and of the base test, and D."""
    current = rows.where(protocol="current")
    i, j = current.columns["i"], current.columns["j"]
    of_new = current.chosen((i == j) & (i > 0))
    base = current.where(j=0, phase="trained")
    return {
        "new tests, at once": 100 * of_new.where(phase="inserted").mean(),
        "new tests, after training": 100 * of_new.where(phase="trained").mean(),
        "base test, before": 100 * base.where(i=0).mean(),
        "base test, in the end": 100 * base.where(i=rows.last).mean(),
        "D": interference(rows)["D"],
    }


def after_last(rows: MatrixTable, protocol: str) -> dict[str, float]:
    """Means of MRR, hits@1 and hits@10 over all test sets after the last snapshot."""
    in_the_end = rows.where(protocol=protocol, phase="trained", i=rows.last)
    tests = [in_the_end.where(j=j) for j in range(rows.last + 1)]
    return {
        name: float(100 * np.mean([test.mean(name) for test in tests]))
        for name in ("mrr", "hits@1", "hits@10")
    }


def interference(rows: MatrixTable) -> dict[str, float]:
    """MEOR's H_old, H_cur, D and A_TN: means of MRR over updates and slots."""
    trained = rows.where(phase="trained")
    by_name: dict[str, list[float]] = {"H_old": [], "H_cur": [], "A_TN": []}
    for i in range(1, rows.last + 1):
        for slot in ENDS:
            update = trained.where(i=i, slot=slot)
            earlier = update.chosen(update.columns["j"] < i)
            by_name["H_old"].append(earlier.where(protocol="old").mean())
            by_name["H_cur"].append(earlier.where(protocol="current").mean())
            by_name["A_TN"].append(update.where(protocol="current", j=i, answer="new").mean())
    means = {name: float(100 * np.nanmean(values)) for name, values in by_name.items()}
    return means | {"D": means["H_old"] - means["H_cur"]}
