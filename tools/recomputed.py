"""Initial vectors and MRR* right after insertion,
computed from the pipeline's tables as docs/method.md defines them.

A second, simple implementation, which uses no code of the library; from embeddings, for ANALOGY
alone.
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
from safetensors.numpy import load_file

Triple = tuple[int, int, int]

CLAMP, TIE = 1e-6, 1e-5
HALVES = ("mrr_star", "mrr_star_entity", "mrr_star_relation")


def rows_of(path: str, *names: str, seeds: Sequence[int] = ()) -> list[tuple[Any, ...]]:
    """Rows of a Parquet table below ``data``, restricted to the columns ``names`` and to some
    ``seeds``, by default all; null numbers are NaN.
    """
    filters = [("seed", "in", list(seeds))] if seeds else None
    table = pq.read_table(Path("data") / path, columns=list(names), filters=filters)
    return list(zip(*(np.asarray(table[name].to_pandas()) for name in names), strict=True))


class Experiment:
    """The tables of one experiment, as dictionaries and dense arrays."""

    def __init__(self, name: str, initializers: list[str]) -> None:
        self.name, self.initializers = name, initializers
        ids = {
            entity: number
            for number, (entity,) in enumerate(rows_of(f"graph/{name}/entities.parquet", "entity"))
        }
        triples = rows_of(f"graph/{name}/triples.parquet", "head", "relation", "tail", "count")
        self.relations = sorted({relation for _, relation, _, _ in triples})
        self.triples: list[Triple] = [
            (ids[h], self.relations.index(r), ids[t]) for h, r, t, _ in triples
        ]
        self.entities = len(ids)
        self.counts = np.zeros((len(self.relations), self.entities, self.entities))
        for (head, relation, tail), (*_, count) in zip(self.triples, triples, strict=True):
            self.counts[relation, head, tail] = count
        self.words = load_file(f"data/words/{name}/vectors.safetensors")["vectors"].astype(float)
        self.novel = self._by_cell("novel", "entity")
        self.insert_triples = self._by_cell("insert_triples", "entity", "triple")
        self.splits: dict[int, dict[str, set[Triple]]] = {}
        for seed, triple, split in rows_of(
            f"sessions/{name}/splits.parquet", "seed", "triple", "split"
        ):
            of_seed = self.splits.setdefault(
                int(seed), {"train": set(), "valid": set(), "test": set()}
            )
            of_seed[split].add(self.triples[triple])

    def _by_cell(self, table: str, *names: str) -> dict[tuple[int, int, int], list[Any]]:
        """Rows of the columns ``names`` of a table in ``data/sessions``, in its order,
        by (size, seed, session).
        """
        by_cell: dict[tuple[int, int, int], list[Any]] = {}
        path = f"sessions/{self.name}/{table}.parquet"
        for size, seed, session, *row in rows_of(path, "size", "seed", "session", *names):
            by_cell.setdefault((int(size), int(seed), int(session)), []).append(
                tuple(map(int, row))
            )
        return by_cell

    def row(self, size: int, seed: int) -> int:
        """Index of a seed in the tensors of a size."""
        return sorted(s for z, s, session in self.novel if (z, session) == (size, 1)).index(seed)

    @cached_property
    def runs(self) -> dict[str, dict[tuple[int, int, int, str], list[tuple[int, Any]]]]:
        """By model, then by (size, seed, session, scope):
        a list of (epoch, [MRR*, entity half, relation half]).
        """
        by_cell: dict[str, Any] = {}
        for model in [*self.initializers, "joint"]:
            group, names = (
                by_cell.setdefault(model, {}),
                ("size", "seed", "session", "scope", "epoch", *HALVES),
            )
            for size, seed, session, scope, epoch, *values in rows_of(
                f"runs/{self.name}/{model}.parquet", *names
            ):
                group.setdefault((int(size), int(seed), int(session), scope), []).append(
                    (int(epoch), values)
                )
        return by_cell


class Session:
    """Entities and triples at a grid point after its first session (D¹)."""

    def __init__(self, experiment: Experiment, size: int, seed: int) -> None:
        self.experiment = experiment
        sets = {
            key[2]: {row[0] for row in rows}
            for key, rows in experiment.novel.items()
            if key[:2] == (size, seed)
        }
        self.order = [row[0] for row in experiment.novel[size, seed, 1]]
        self.novel = sets[1]
        later = set().union(*(ids for session, ids in sets.items() if session > 1))
        splits = experiment.splits[seed]
        self.train, self.valid, self.test = (
            {t for t in splits[name] if not {t[0], t[2]} & later}
            for name in ("train", "valid", "test")
        )
        everyone = {end for triples in splits.values() for h, _, t in triples for end in (h, t)}
        self.members = everyone - later
        self.known = self.members - self.novel
        self.eligible = self.known & {end for h, _, t in self.old(self.train) for end in (h, t)}
        rows = experiment.insert_triples.get((size, seed, 1), [])
        self.insert_triples = {
            entity: [experiment.triples[t] for e, t in rows if e == entity] for entity in self.order
        }

    def old(self, triples: Iterable[Triple]) -> set[Triple]:
        """Triples without a novel end."""
        return {t for t in triples if not {t[0], t[2]} & self.novel}

    def scopes(self) -> dict[str, tuple[set[Triple], set[Triple], set[int]]]:
        """By scope: queried triples, filtered triples, candidate entities."""
        true, learned = self.train | self.valid | self.test, self.train | self.valid
        given = {triple for triples in self.insert_triples.values() for triple in triples}
        heldout = self.valid | self.test
        return {
            "all": (self.test, learned, self.members),
            "known": (self.old(self.test), learned, self.members),
            "known_closed": (self.old(self.test), learned, self.known),
            "novel": (true - self.old(true) - given, self.old(learned) | given, self.members),
            "novel_heldout": (heldout - self.old(heldout), self.train, self.members),
        }


# Initial vectors


def parts(vector: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Scalars (..., d / 2), a-halves (..., d / 4) and b-halves (..., d / 4) of
    ANALOGY's vectors (..., d).
    """
    d = vector.shape[-1]
    return vector[..., : d // 2], vector[..., d // 2 : 3 * d // 4], vector[..., 3 * d // 4 :]


def there(vector: np.ndarray, relation: np.ndarray) -> np.ndarray:
    """vᵀW."""
    (s, a, b), (r, x, y) = parts(vector), parts(relation)
    return np.concatenate([s * r, a * x - b * y, b * x + a * y], -1)


def back(vector: np.ndarray, relation: np.ndarray) -> np.ndarray:
    """vᵀW⁻¹, with |r| and x² + y² clamped to at least ``CLAMP``."""
    (s, a, b), (r, x, y) = parts(vector), parts(relation)
    size = np.maximum(x**2 + y**2, CLAMP)
    scalar = np.where(r < 0, -1, 1) * s / np.maximum(abs(r), CLAMP)
    return np.concatenate([scalar, (a * x + b * y) / size, (b * x - a * y) / size], -1)


def unit(vectors: np.ndarray) -> np.ndarray:
    return vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-12)


#: Scores of all entities, (E,), and the ids of the entities that may be indicators.
Ranked = tuple[np.ndarray, set[int]]


@dataclass(frozen=True)
class Around:
    """A novel entity in its session, and the scores by which its indicators are chosen."""

    session: Session
    entity: int
    vectors: np.ndarray  #: entities of Θ⁰, (E, d)
    relations: np.ndarray  #: relations of Θ⁰, (R, d)

    @cached_property
    def by_words(self) -> Ranked | None:
        """Cosines of word vectors; None if the entity or all eligible
        entities lack a word vector.
        """
        words = self.session.experiment.words
        candidates = {e for e in self.session.eligible if words[e].any()}
        units = unit(words)
        return (
            (units @ units[self.entity], candidates)
            if words[self.entity].any() and candidates
            else None
        )

    @cached_property
    def by_relations(self) -> Ranked | None:
        """Σ_r cos(v_e, ᾱ_r) over the relations of the insert triples;
        None without insert triples.
        """
        placed: dict[int, list[np.ndarray]] = {}
        for head, relation, tail in self.session.insert_triples[self.entity]:
            way, other = (there, head) if tail == self.entity else (back, tail)
            placed.setdefault(relation, []).append(
                way(self.vectors[other], self.relations[relation])
            )
        means = [unit(np.mean(group, axis=0)) for group in placed.values()]
        scores = sum((unit(self.vectors) @ mean for mean in means), np.zeros(len(self.vectors)))
        return (scores, self.session.eligible) if placed and self.session.eligible else None


#: Indicators, and the score of the last indicator minus that of the next entity.
Chosen = tuple[set[int], float]


def best(scores: np.ndarray, among: set[int], k: int) -> Chosen:
    """The ``k`` entities in ``among`` with the highest scores; ties go to the lower id."""
    order = sorted(among, key=lambda e: (-scores[e], e))
    gap = scores[order[k - 1]] - scores[order[k]] if len(order) > k else np.inf
    return set(order[:k]), float(gap)


def mean(around: Around, **_: int) -> Chosen:
    return around.session.known, np.inf


def es(around: Around, k: int) -> Chosen:
    return best(*around.by_words, k) if around.by_words else rs(around, k)


def rs(around: Around, k: int) -> Chosen:
    return best(*around.by_relations, k) if around.by_relations else mean(around)


def ers(around: Around, k: int, candidates: int) -> Chosen:
    if not (around.by_words and around.by_relations):
        return rs(around, k) if around.by_relations else es(around, k)
    preliminary, gap = best(*around.by_words, candidates)
    chosen, last = best(around.by_relations[0], preliminary, k)
    return chosen, min(gap, last)


#: The initializers that are recomputed, each with the function that chooses its indicators.
RECOMPUTED: dict[str, Callable[..., Chosen]] = {"mean": mean, "es": es, "rs": rs, "ers": ers}


# MRR* right after insertion


def mrr_star(
    session: Session,
    scores: np.ndarray,
    scope: tuple[set[Triple], set[Triple], set[int]],
    tie: float = TIE,
) -> tuple[float, float, float]:
    """MRR*, entity half and relation half in [0, 1] of one scope (equation 7); NaN without queries.

    Args:
        scores: of all triples, shape (R, E, E): relation, head, tail; ``scope``: a value of
            ``Session.scopes``.
        tie: two scores are tied if they differ by at most this share of the largest |score| of the
            query.
    """
    queried, filtered, candidates = scope
    if not queried:
        return (np.nan,) * 3
    counts = session.experiment.counts
    barred = np.zeros(counts.shape, dtype=bool)
    for head, relation, tail in filtered:
        barred[relation, head, tail] = True
    may_answer = np.isin(np.arange(counts.shape[1]), list(candidates))
    everything = np.ones(len(counts), dtype=bool)
    of_relation: dict[int, list[float]] = {}
    relation_terms = []
    for head, relation, tail in queried:
        ends = of_relation.setdefault(relation, [])
        tables = scores, counts, barred
        ends.append(term(*(table[relation, :, tail] for table in tables), may_answer, head, tie))
        ends.append(term(*(table[relation, head] for table in tables), may_answer, tail, tie))
        relation_terms.append(
            term(*(table[:, head, tail] for table in tables), everything, relation, tie)
        )
    true = session.train | session.valid | session.test
    weights = {r: sum(counts[t[1], t[0], t[2]] for t in true if t[1] == r) for r in of_relation}
    entity = sum(weights[r] * np.mean(group) for r, group in of_relation.items()) / sum(
        weights.values()
    )
    half = float(np.mean(relation_terms))
    return (entity + half) / 2, entity, half


def term(
    scores: np.ndarray,
    counts: np.ndarray,
    barred: np.ndarray,
    able: np.ndarray,
    answer: int,
    tie: float,
) -> float:
    """1 / (|R_G - R_P| + 1) of one query; arrays have an entry for each entity or relation."""
    competitors = able & ~barred
    competitors[answer] = False
    ahead, width = scores - scores[answer], tie * np.abs(scores).max()
    wins = np.where(ahead > width, 1.0, np.where(ahead < -width, 0.0, 0.5))
    true_rank = 1 + (competitors & (counts > counts[answer])).sum()
    predicted_rank = 1 + wins[competitors & (counts != counts[answer])].sum()
    return float(1 / (abs(true_rank - predicted_rank) + 1))


# MRR* under every reading of the metric, from the terms of single queries

#: Choices of the splits that are queried, of the shares of slots, and of the triples that are no
#: candidates.
QUERIES = {
    "test": ["test"],
    "held_out": ["valid", "test"],
    "all": ["train", "valid", "test"],
    "train": ["train"],
}
SLOTS = {
    "alike": {"head": 1 / 3, "relation": 1 / 3, "tail": 1 / 3},
    "entities": {"head": 1 / 2, "tail": 1 / 2},
    "halves": {"head": 1 / 4, "relation": 1 / 2, "tail": 1 / 4},
}
FILTERS, TRUTHS = ("learned", "true", "none"), ("all", "split")
ABOUT, WEIGHTS = ("any", "known", "novel", "both"), ("triple", "relation", "observations")

Run = tuple[str, int, int, int]  #: Model, number of indicators, size and seed.
Group = tuple[str, str, str]  #: Choices of queries, about and weights.
#: MRR*; shape: (choices of slots, of filters, of truths).
Values = dict[Run, dict[Group, np.ndarray]]


def seeds_of(case: str) -> list[int]:
    """The seeds of a case of the readings."""
    return sorted({int(seed) for (seed,) in rows_of(f"beyond/readings/{case}.parquet", "seed")})


def readings_there(case: str, seeds: Sequence[int] = ()) -> Values:
    """MRR* under every reading at some seeds, by default all, from the table of readings of a
    case; infinite where a row is missing.
    """
    values: Values = {}
    places = [
        {name: place for place, name in enumerate(names)} for names in (SLOTS, FILTERS, TRUTHS)
    ]
    names = (
        "model",
        "k",
        "size",
        "seed",
        "queries",
        "about",
        "weights",
        "slots",
        "filter",
        "truth",
        "mrr_star",
    )
    for model, k, size, seed, *group, slots, filtering, truth, mrr_star in rows_of(
        f"beyond/readings/{case}.parquet", *names, seeds=seeds
    ):
        of_run = values.setdefault((model, int(k), int(size), int(seed)), {})
        shape = tuple(map(len, places))
        of_group = of_run.setdefault(tuple(group), np.full(shape, np.inf))  # type: ignore[arg-type]
        of_group[places[0][slots], places[1][filtering], places[2][truth]] = mrr_star
    return values


class Ranked:
    """The table of ranks of a case at some seeds, by default all: an array for each column."""

    def __init__(self, case: str, seeds: Sequence[int] = ()) -> None:
        filters = [("seed", "in", list(seeds))] if seeds else None
        path = Path("data") / f"beyond/readings/{case}.ranks.parquet"
        table = pq.read_table(path, filters=filters)
        self.columns = {name: np.asarray(table[name].to_pandas()) for name in table.column_names}
        terms = [
            [self.columns[f"closeness_{name}_{truth}"] for truth in TRUTHS] for name in FILTERS
        ]
        self.terms = np.moveaxis(np.array(terms), -1, 0)  #: of MRR*; shape: (rows, filters, truths)

    def runs(self) -> Iterator[tuple[Run, np.ndarray]]:
        """Each model at a grid point, with the places of its rows."""
        places: dict[Run, list[int]] = {}
        names = ("model", "k", "size", "seed")
        for place, run in enumerate(
            zip(*(self.columns[name].tolist() for name in names), strict=True)
        ):
            places.setdefault(run, []).append(place)
        yield from ((run, np.array(rows)) for run, rows in places.items())

    def readings_here(self) -> Values:
        """MRR* under every reading, computed from the terms."""
        groups = list(product(QUERIES, ABOUT, WEIGHTS))
        return {
            run: {group: self._means(rows, *group) for group in groups} for run, rows in self.runs()
        }

    def _means(self, rows: np.ndarray, queries: str, about: str, weights: str) -> np.ndarray:
        relation, count, hidden = (
            self.columns[name][rows] for name in ("relation", "count", "hidden")
        )
        queried = np.isin(self.columns["split"][rows], QUERIES[queries])
        if about in ("known", "novel"):
            queried &= (self.columns["novel"][rows] == 1) == (about == "novel")
        weight = {
            "triple": np.ones(len(rows)),
            "observations": count.astype(float),
            "relation": np.zeros(len(rows)),
        }
        for name in set(relation[queried]) if weights == "relation" else ():
            of_relation, tails = relation == name, hidden == "tail"
            observed, number = (
                count[of_relation & tails].sum(),
                (of_relation & tails & queried).sum(),
            )
            weight["relation"][of_relation] = observed / number
        by_slot = {}
        for slot in ("head", "relation", "tail"):
            chosen = rows[queried & (hidden == slot)]
            of_slot = weight[weights][queried & (hidden == slot)]
            if (weights, slot) == ("relation", "relation"):
                of_slot = np.ones(len(chosen))
            total = of_slot.sum() if len(chosen) else np.nan
            by_slot[slot] = np.tensordot(of_slot, self.terms[chosen], 1) / total
        return np.array(
            [
                sum(share * by_slot[slot] for slot, share in shares.items())
                for shares in SLOTS.values()
            ]
        )
