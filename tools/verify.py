"""Recompute numbers of the pipelines and their reports from the pipelines' tables alone, and
compare.

A second, simple implementation of what docs/method.md and docs/continual.md define, which uses no
code of the library. It computes mean epochs to convergence and, for ANALOGY alone, initial vectors
of some initializers and MRR* right after insertion at random grid points. Of graphs that grow, it
computes R[i, j] by the first embedding and by the mean of its vectors, for ComplEx alone, and what
the report shows of R. Run it in the folder of dvc.yaml.
"""

from __future__ import annotations

import argparse
import sys
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from ruamel.yaml import YAML
from safetensors.numpy import load_file

#: Two scores are tied if they differ by at most this share of the query's largest |score|.
TIE = 1e-5
SPLITS = ["train", "valid", "test"]
Values = Mapping[str, Any]


@dataclass
class Check:
    """The comparison of recomputed numbers with those of tables."""

    about: str
    #: maximum absolute difference at which two numbers agree, in their unit
    tolerance: float
    number: int = 0
    worst: float = 0.0
    disagreements: list[str] = field(default_factory=list)

    def compare(
        self, place: str, here: pd.DataFrame, there: Any, highest: pd.DataFrame | None = None
    ) -> None:
        """Compare the rows of two tables by their index, and record those that disagree. Two nulls
        agree; a row that one table lacks disagrees.

        Args:
            there: has the columns of ``here``, and may have others.
            highest: if numbers from ``here`` up to these agree.
        """
        index = here.index.union(there.index, sort=False)
        lowest, numbers, most = (
            each[here.columns].astype(float).reindex(index, fill_value=np.inf).to_numpy()
            for each in (here, there, here if highest is None else highest)
        )
        apart = np.maximum(lowest - numbers, numbers - most)
        apart = np.where(np.isnan(lowest) & np.isnan(numbers), 0, apart)
        apart = np.nan_to_num(apart, nan=np.inf, posinf=np.inf)
        self.number += len(index)
        self.worst = max(self.worst, float(apart.max(initial=0)))
        for row in np.flatnonzero((apart > self.tolerance).any(1)):
            column = apart[row].argmax()
            key = index[row] if isinstance(index[row], tuple) else (index[row],)
            parts = [
                f"{name or ''} {part}".strip() for name, part in zip(index.names, key, strict=True)
            ]
            at = ", ".join([*parts, str(here.columns[column]), place])
            both = f"{lowest[row, column]:.6g} here, {numbers[row, column]:.6g} there"
            self.disagreements.append(f"{self.about}, {at}: {both}")

    def __str__(self) -> str:
        numbers = f"{self.number:9}{self.worst:20.1e}{self.tolerance:11.0e}"
        return f"{self.about:18}{numbers}{len(self.disagreements):15}"


def table(path: str, seeds: Sequence[int] = ()) -> pd.DataFrame:
    """A table below ``data`` with plain values, of some ``seeds``, by default all."""
    filters = [("seed", "in", list(seeds))] if seeds else None
    frame = pd.read_parquet(Path("data", f"{path}.parquet"), filters=filters)
    return frame.astype(dict.fromkeys(frame.select_dtypes("category"), object))


def where(frame: pd.DataFrame, **values: Any) -> pd.DataFrame:
    """The rows with these values in their columns."""
    return frame[(frame[list(values)] == list(values.values())).all(axis=1)]


# A grid point after its first session (D¹)


class Experiment:
    """The tables of one experiment."""

    def __init__(self, name: str, initializers: list[str]) -> None:
        self.name, self.initializers = name, initializers
        named = table(f"graph/{name}/triples")
        entities = pd.Index(table(f"graph/{name}/entities")["entity"])
        relations = pd.Index(sorted(set(named["relation"])))
        of_columns = {"head": entities, "relation": relations, "tail": entities}
        ids = [index.get_indexer(named[column]) for column, index in of_columns.items()]
        self.triples = np.stack(ids, 1)  #: (T, 3)
        self.counts = np.zeros((len(relations), len(entities), len(entities)))
        head, relation, tail = ids
        self.counts[relation, head, tail] = named["count"]
        self.words = load_file(f"data/words/{name}/vectors.safetensors")["vectors"].astype(float)
        self.splits = table(f"sessions/{name}/splits")
        self.novel = table(f"sessions/{name}/novel")
        self.insert_triples = table(f"sessions/{name}/insert_triples")
        self.runs = {model: table(f"runs/{name}/{model}") for model in [*initializers, "joint"]}

    def known_share(self, size: int) -> float:
        """The weight of *known* in *weighted*."""
        known = novel = 0
        for seed in self.novel["seed"].unique():
            session = Session(self, size, seed)
            known += (session.test & session.is_old).sum()
            novel += ((session.train | session.valid | session.test) & ~session.is_old).sum()
        return float(known / (known + novel))


class Session:
    """Masks of the entities, (E,), and of the triples, (T,), at a grid point."""

    def __init__(self, experiment: Experiment, size: int, seed: int) -> None:
        self.experiment = experiment
        novel = where(experiment.novel, size=size, seed=seed)
        self.novel = novel["entity"].to_numpy()
        splits, ends = where(experiment.splits, seed=seed), experiment.triples[:, [0, 2]]
        split = np.full(len(ends), "", object)
        split[splits["triple"]] = splits["split"]
        self.train, self.valid, self.test = (split == name for name in SPLITS)
        self.is_old = ~np.isin(ends, self.novel).any(1)
        self.members = self.among(ends[splits["triple"]])
        self.known = self.members & ~self.among(self.novel)
        self.eligible = self.known & self.among(ends[self.train & self.is_old])
        self.inserted = where(experiment.insert_triples, size=size, seed=seed)

    def among(self, entities: Any) -> np.ndarray:
        return np.isin(np.arange(len(self.experiment.words)), entities)

    def scopes(self) -> dict[str, Asked]:
        """What the measure asks, by scope; ``weighted`` follows from two of them."""
        learned, heldout = self.train | self.valid, self.valid | self.test
        is_given = np.isin(np.arange(len(self.train)), self.inserted["triple"])
        head, relation, tail = self.experiment.triples.T
        times = np.where(self.train, self.experiment.counts[relation, head, tail], 1)
        new = (learned | self.test) & ~self.is_old & ~is_given
        old = self.test & self.is_old
        before, asked_for = learned & self.is_old, self.test & ~is_given
        return {
            "known": Asked(old, before, self.members),
            "known_closed": Asked(old, before, self.known),
            "novel": Asked(times * new, before, self.members),
            "held_out": Asked(asked_for, learned, self.members),
            "novel_held_out": Asked(heldout & ~self.is_old & ~is_given, self.train, self.members),
        }


@dataclass
class Asked:
    """The queries of a scope: how often each triple is asked, (T,); the triples of the filter of
    MRR*, (T,); and the entities that may answer, (E,). MRR leaves out every other true triple.
    """

    times: np.ndarray
    filtered: np.ndarray
    candidates: np.ndarray


# Initial vectors

CLAMP = 1e-6
#: A novel entity is not compared if scores of the last indicator and of the next entity differ by
#: less than this.
UNDECIDED = 1e-5
RECOMPUTED = ("mean", "es", "rs", "ers")


def as_blocks(rows: np.ndarray) -> np.ndarray:
    """ANALOGY's vectors, (..., d), as complex numbers, (..., 3d / 4): scalars, then a + bi of each
    2 × 2 block. vᵀW is then a product of numbers.
    """
    d = rows.shape[-1]
    scalars, real, imaginary = np.split(rows.astype(float), [d // 2, 3 * d // 4], -1)
    return np.concatenate([scalars, real + 1j * imaginary], -1)


def inverse(relation: np.ndarray) -> np.ndarray:
    """W⁻¹ of ``as_blocks``, with |r| and x² + y² clamped to at least ``CLAMP``."""
    scalars, blocks = np.split(relation, [2 * relation.shape[-1] // 3], -1)
    sign = np.where(scalars.real < 0, -1, 1)
    of_blocks = blocks.conj() / np.maximum(abs(blocks) ** 2, CLAMP)
    return np.concatenate([sign / np.maximum(abs(scalars), CLAMP), of_blocks], -1)


def unit(vectors: np.ndarray) -> np.ndarray:
    return vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-12)


def by_words(session: Session, entity: int) -> np.ndarray | None:
    """Cosines of word vectors, -∞ for what may be no indicator; None without a word vector."""
    words = session.experiment.words
    able = session.eligible & words.any(1)
    scores = np.where(able, unit(words) @ unit(words[entity]), -np.inf)
    return scores if words[entity].any() and able.any() else None


def by_relations(
    session: Session, entity: int, vectors: np.ndarray, relations: np.ndarray
) -> np.ndarray | None:
    """Σ_r cos(v_e, ᾱ_r) over the relations of the insert triples, -∞ for what may be no indicator;
    None without insert triples.
    """
    triples = session.experiment.triples[where(session.inserted, entity=entity)["triple"]]
    scores = np.where(session.eligible, 0.0, -np.inf)
    for relation in np.unique(triples[:, 1]):
        mapped = [
            vectors[head] * relations[relation]
            if tail == entity
            else vectors[tail] * inverse(relations[relation])
            for head, _, tail in triples[triples[:, 1] == relation]
        ]
        scores += (unit(vectors) @ unit(np.mean(mapped, 0)).conj()).real
    return scores if len(triples) and session.eligible.any() else None


def best(scores: np.ndarray, k: int) -> tuple[np.ndarray, float]:
    """The ``k`` entities with the highest scores (ties go to the lower id), and the score of the
    last one minus that of the next.
    """
    order = np.argsort(-scores, kind="stable")
    order = order[np.isfinite(scores[order])]
    gap = scores[order[k - 1]] - scores[order[k]] if len(order) > k else np.inf
    return order[:k], float(gap)


def indicators(
    model: str,
    session: Session,
    words: np.ndarray | None,
    relations: np.ndarray | None,
    options: Values,
) -> tuple[np.ndarray, float]:
    """The indicators of an initializer by two scores of all entities, and their gap as in
    ``best``.
    """
    if model == "ers" and words is not None and relations is not None:
        preliminary, gap = best(words, options["candidates"])
        narrowed = np.full(len(words), -np.inf)
        narrowed[preliminary] = relations[preliminary]
        chosen, last = best(narrowed, options["k"])
        return chosen, min(gap, last)
    orders = {"es": (words, relations), "rs": (relations,), "ers": (relations, words)}
    for scores in orders.get(model, ()):
        if scores is not None:
            return best(scores, options["k"])
    return np.flatnonzero(session.known), np.inf


# The measure right after insertion


def ranks(scores: np.ndarray, able: np.ndarray, answer: np.ndarray, tie: float) -> np.ndarray:
    """The rank of the answer of queries, (Q,), less 1, among the ``able`` candidates, (Q, N)."""
    ahead = scores - scores[np.arange(len(answer)), answer][:, None]
    width = tie * np.abs(scores).max(1, keepdims=True)
    wins = np.where(ahead > width, 1.0, np.where(ahead < -width, 0.0, 0.5))
    return np.asarray((wins * able).sum(1))


def terms(
    scores: np.ndarray,
    counts: np.ndarray,
    able: tuple[np.ndarray, np.ndarray],
    answer: np.ndarray,
    tie: float,
) -> tuple[np.ndarray, np.ndarray]:
    """1 / (|R_G - R_P| + 1), and 1 / rank of queries, (Q,); arrays, (Q, N), have a column for each
    entity or relation; ``able``: candidates of MRR* and of MRR.
    """
    query = np.arange(len(answer))
    for each in able:
        each[query, answer] = False
    of_answer = counts[query, answer][:, None]
    true_rank = (able[0] & (counts > of_answer)).sum(1)
    predicted_rank = ranks(scores, able[0] & (counts != of_answer), answer, tie)
    star = 1 / (abs(true_rank - predicted_rank) + 1)
    return star, 1 / (1 + ranks(scores, able[1], answer, tie))


def measures(session: Session, scores: np.ndarray, asked: Asked, tie: float = TIE) -> np.ndarray:
    """``MEASURES`` in [0, 1] of one scope; NaN without queries.

    Args:
        scores: of all triples, shape (R, E, E): relation, head, tail.
    """
    triples, counts = session.experiment.triples, session.experiment.counts
    if not asked.times.any():
        return np.full(6, np.nan)
    true = session.train | session.valid | session.test
    able = []
    for barred in (asked.filtered, true):
        head, relation, tail = triples[barred].T
        allowed = np.ones(counts.shape, bool)
        allowed[relation, head, tail] = False
        able.append(allowed)
    times = asked.times[asked.times > 0].astype(float)
    head, relation, tail = triples[asked.times > 0].T
    places = {"head": (relation, slice(None), tail), "tail": (relation, head)}
    by_end = {}
    for end, answer in (("head", head), ("tail", tail)):
        at = places[end]
        allowed = tuple(each[at] & asked.candidates for each in able)
        by_end[end] = terms(scores[at], counts[at], allowed, answer, tie)
    columns = (slice(None), head, tail)
    of_relation = terms(
        scores[columns].T,
        counts[columns].T,
        tuple(each[columns].T.copy() for each in able),
        relation,
        tie,
    )
    known = triples[true]
    seen = np.bincount(known[:, 1], counts[known[:, 1], known[:, 0], known[:, 2]], len(counts))
    number = np.bincount(relation, times, len(counts))
    is_asked = number > 0
    values = []
    for which in (0, 1):
        of_ends = times * (by_end["head"][which] + by_end["tail"][which]) / 2
        means = np.bincount(relation, of_ends, len(counts))[is_asked] / number[is_asked]
        entity = np.average(means, weights=seen[is_asked])
        half = np.average(of_relation[which], weights=times)
        values += [(entity + half) / 2, entity, half]
    return np.array(values)


def check_grid_point(
    experiment: Experiment, size: int, seed: int, options: Values, initial: Check, immediate: Check
) -> int:
    """Compare initial vectors, and MRR* and its halves by model and scope;
    returns the number of vectors skipped.
    """
    session, folder = Session(experiment, size, seed), f"data/embeddings/{experiment.name}"
    theta0 = load_file(f"{folder}/theta0/size={size:02d}.safetensors")
    joint = load_file(f"{folder}/joint.safetensors")
    left_open = 0
    for model, runs in experiment.runs.items():
        place = f"{model}, {experiment.name}, size {size}, seed {seed}"
        trained = joint if model == "joint" else theta0
        seeds = trained["seed"].tolist()
        if model == "joint" and len(seeds) < experiment.novel["seed"].nunique():
            continue  # the mean of a few models that all seeds share
        row = seeds.index(seed)
        vectors, relations = (as_blocks(trained[part][row]) for part in ("entity", "relation"))
        if model != "joint":
            path = f"data/runs/{experiment.name}/{model}.safetensors"
            stored = as_blocks(load_file(path)[f"size={size:02d}"][row])[: len(session.novel)]
            if model in RECOMPUTED:
                here = initial_vectors(model, session, vectors, relations, options[model])
                there = pd.DataFrame(stored.view(float), session.novel)
                initial.compare(place, here, there.loc[here.index])
                left_open += len(there) - len(here)
            vectors[session.novel] = stored
        scores = np.stack([(vectors * relation @ vectors.conj().T).real for relation in relations])
        there = where(runs, size=size, seed=seed, epoch=0).set_index("scope")
        here = immediate_measures(session, scores, there, immediate.tolerance)
        share = experiment.known_share(size)
        here.loc["weighted"] = share * here.loc["known"] + (1 - share) * here.loc["novel"]
        immediate.compare(place, here, there)
    return left_open


def initial_vectors(
    model: str, session: Session, vectors: np.ndarray, relations: np.ndarray, options: Values
) -> pd.DataFrame:
    """The vectors of the novel entities whose last indicator is beyond doubt; a row for each."""
    rows = {}
    for entity in session.novel:
        words, related = (
            by_words(session, entity),
            by_relations(session, entity, vectors, relations),
        )
        chosen, gap = indicators(model, session, words, related, options)
        if gap >= UNDECIDED:
            rows[entity] = vectors[chosen].mean(0).view(float)
    return pd.DataFrame.from_dict(rows, "index", columns=range(2 * vectors.shape[1]))


MEASURES = ["mrr_star", "mrr_star_entity", "mrr_star_relation", "mrr", "mrr_entity", "mrr_relation"]


def immediate_measures(
    session: Session, scores: np.ndarray, there: pd.DataFrame, tolerance: float
) -> pd.DataFrame:
    """``MEASURES`` by scope.

    Rounding of scores decides which scores are tied. Where the numbers ``there`` differ, those of a
    tie width of 0.9 or 1.1 ``TIE`` may agree with them.
    """
    rows = {}
    for scope, asked in session.scopes().items():
        for share in (1, 0.9, 1.1):
            here = measures(session, scores, asked, share * TIE)
            rows.setdefault(scope, here)
            if np.allclose(here, there.loc[scope, MEASURES], 0, tolerance, equal_nan=True):
                rows[scope] = here
                break
    return pd.DataFrame.from_dict(rows, "index", columns=MEASURES)


# Epochs to convergence


def epochs_of(experiment: Experiment, seeds: int, margin: float, most: int) -> pd.DataFrame:
    """Epochs of the fine-tuned runs by initializer: mean over all runs, mean over those that end,
    and how many do not.
    """
    point, groups = ["size", "seed"], ["known", "novel"]
    joint = experiment.runs["joint"].set_index([*point, "scope"])["mrr"]
    rows = {}
    for model, runs in experiment.runs.items():
        tuned = runs[(runs["seed"] < seeds) & runs["scope"].isin(groups)]
        if model == "joint" or not tuned["epoch"].any():
            continue
        tuned = tuned.dropna(subset="mrr").join(joint.rename("joint"), on=[*point, "scope"])
        tuned["within"] = tuned["mrr"] >= tuned["joint"] - margin
        both = tuned.groupby([*point, "epoch"])["within"].all().reset_index()
        first = both[both["within"]].groupby(point)["epoch"].min()
        epochs = first.reindex(both.groupby(point).size().index)
        rows[model] = [epochs.fillna(most).mean(), epochs.mean(), float(epochs.isna().sum())]
    return pd.DataFrame.from_dict(
        rows, "index", columns=["all runs", "runs that end", "do not end"]
    )


def check_epochs(experiment: Experiment, params: Values, check: Check) -> None:
    """Compare epochs to convergence with Table 2."""
    settings = params["experiments"][experiment.name]
    most = {**params["finetuning"], **(settings["finetuning"] or {})}["max_epochs"]
    margin, seeds = params["convergence"]["margin"], settings["finetuned"]["seeds"]
    here = epochs_of(experiment, seeds, margin, most)
    table2 = pd.read_csv(f"reports/tables/table2_convergence_{experiment.name}.csv")
    check.compare(experiment.name, here, table2.set_index("model"))


def verify(params: Values, number: int) -> list[Check]:
    """Compare random grid points, and epochs of experiments with one source;
    print which vectors are skipped.
    """
    experiments = []
    for name, settings in params["experiments"].items():
        listed = settings.get("initializers", "all")
        chosen = [key for key in params["initializers"] if listed == "all" or key in listed]
        experiments.append(Experiment(name, chosen))
    initial, immediate = Check("initial vectors", 1e-5), Check("the measure", 1e-5)
    epochs = Check("epochs", 6e-3)
    rng = np.random.default_rng(0)
    if params["embedding"]["model"] == "analogy":
        points = [
            (experiment, *point)
            for experiment in experiments
            for point in experiment.novel.groupby(["size", "seed"]).groups
        ]
        left_open = sum(
            check_grid_point(*points[place], params["initializers"], initial, immediate)
            for place in rng.permutation(len(points))[:number]
        )
        others = ", ".join(name for name in params["initializers"] if name not in RECOMPUTED)
        print(
            f"Not computed again: vectors of {others or 'none'}; and {left_open} "
            f"vectors whose last indicator scores less than {UNDECIDED:.0e} above the next entity."
        )
    else:
        print(
            "Not computed again: vectors and the measure, which this check "
            "recomputes only for the model ANALOGY."
        )
    for experiment in experiments:
        if not params["experiments"][experiment.name]["graph"].get("extend"):
            check_epochs(experiment, params, epochs)
    return [initial, immediate, epochs]


# Graphs that grow: the graph and its queries

#: A difference of scores within this share of the limit of a tie may be either: the library's
#: numbers are float32.
ROUNDING = 1e-6
QUERIES_AT_ONCE = 500  #: Rows of one table of scores.
TRIPLE = ["head", "relation", "tail"]
#: By the slot that a query hides: the slot that it gives.
OTHER_END = {"head": "tail", "tail": "head"}
HITS = (1, 3, 10)
MEASURES = ["queries", "mrr", *(f"hits@{k}" for k in HITS)]
#: By benchmark, its column in data/raw/snapshots/triples.parquet.
LKGE = {name: f"lkge_{name.lower()}" for name in ("ENTITY", "RELATION", "FACT", "HYBRID")}
GRAPHS = {f"Graph{name}": f"graph_{name.lower()}" for name in ("Equal", "Higher", "Lower")}
COLUMNS = LKGE | GRAPHS | {f"FBinc-{size}": f"fbinc_{size.lower()}" for size in "SML"}
ABSENT = 255  #: In such a column: the triple takes no part.
MODEL = "complex"  #: The model of which R[i, j] is computed again.
#: Columns that tell the parts of a chain apart (no initializer and strategy: the first embedding),
#: and the rows of ``matrix.parquet`` of a part and a seed.
STEP, GROUP_OF_R = ["initializer", "strategy", "phase", "i"], ["protocol", "j", "slot", "answer"]


def chains_of(settings: Values) -> list[tuple[str, str]]:
    """Initializers with their strategies, in the order of params."""
    pairs, chains = settings["pairs"], []
    for initializer in settings["initializers"]:
        strategies = pairs if pairs == "all" else pairs.get(initializer, [])
        if strategies == "all":
            strategies = list(settings["strategies"])
        chains += [(initializer, strategy) for strategy in strategies]
    return chains


def plain_steps(settings: Values, last: int) -> pd.DataFrame:
    """The parts of chains whose new vectors are the mean of the known ones, up to a ``last``
    snapshot; columns ``STEP``. Whatever trains later, those of snapshot 1 are.
    """
    steps = [("", "", "trained", 0)]
    parts_of = list(product(range(1, last + 1), ("inserted", "trained")))
    for initializer, strategy in chains_of(settings):
        plain = parts_of if strategy == "insert" else parts_of[:1]
        if initializer == "mean":
            steps += [(initializer, strategy, phase, i) for i, phase in plain]
    return pd.DataFrame(steps, columns=STEP)


def triples_of(timeline: str) -> pd.DataFrame:
    """The triples of names of a benchmark, or of a folder as LKGE writes it, in order; columns
    ``snapshot`` and ``split``, too.
    """
    if timeline in COLUMNS:
        column = COLUMNS[timeline]
        path = "data/raw/snapshots/triples.parquet"
        listed = pd.read_parquet(path, columns=[*TRIPLE, column])
        listed = listed[listed[column] != ABSENT].sort_values(column, kind="stable")
        place = listed[column].to_numpy(int)
        split = np.array(SPLITS)[place % 3]
        return listed[TRIPLE].assign(snapshot=place // 3, split=split)
    rows = [
        (*line.split("\t"), snapshot, split)
        for snapshot, split in product(range(len(list(Path(timeline).iterdir()))), SPLITS)
        for line in Path(timeline, f"{snapshot}/{split}.txt").read_text("utf-8").splitlines()
    ]
    return pd.DataFrame(rows, columns=[*TRIPLE, "snapshot", "split"])


class GrowingGraph:
    """The triples of a timeline, with ids in the order of first appearance."""

    def __init__(self, timeline: str, most: int | None = None) -> None:
        """``most``: the largest number of triples of a test set that are ranked (None: all)."""
        triples = triples_of(timeline)
        ends = pd.factorize(triples[["head", "tail"]].to_numpy(object).ravel())[0].reshape(-1, 2)
        relations = pd.factorize(triples["relation"])[0]
        triples = triples.assign(head=ends[:, 0], relation=relations, tail=ends[:, 1])
        snapshots = range(triples["snapshot"].max() + 1)
        of_snapshot = triples.groupby("snapshot")[TRIPLE].max().cummax() + 1
        #: number of those known after each snapshot
        self.entities = of_snapshot[["head", "tail"]].max(axis=1).tolist()
        self.relations = of_snapshot["relation"].tolist()
        tests = where(triples, split="test")
        #: the triples that are ranked, shapes (N, 3)
        self.tests = [
            drawn(where(tests, snapshot=j)[TRIPLE].to_numpy(), most, j) for j in snapshots
        ]
        first = triples.groupby(TRIPLE)["snapshot"].min().rename("arrival")
        read = triples[triples["split"] != "valid"]  # what LKGE's code reads
        in_lkge = read.groupby(TRIPLE)["snapshot"].min().rename("in_lkge")
        #: the first snapshots that have a fact: in any split, and in those that LKGE's code reads
        self.facts = first.to_frame().join(in_lkge).fillna(np.inf).reset_index()
        #: by test set and the slot that its queries hide
        self.answers = {place: self._answers(*place) for place in product(snapshots, OTHER_END)}

    @property
    def unranked(self) -> list[int]:
        """Test sets with a relation that the first embedding lacks: a later one is fitted."""
        relations = self.relations[0]
        return [j for j, test in enumerate(self.tests) if (test[:, 1] >= relations).any()]

    def _answers(self, j: int, slot: str) -> pd.DataFrame:
        """The right answers of the queries of test set j for a slot; columns ``query``, ``answer``,
        and the first snapshots as in ``facts``.
        """
        queries = pd.DataFrame(self.tests[j], columns=TRIPLE).drop(columns=slot)
        queries = queries.rename_axis("query").reset_index()
        answers = queries.merge(self.facts.rename(columns={slot: "answer"}))
        return answers.sort_values("query")


def drawn(triples: np.ndarray, most: int | None, j: int) -> np.ndarray:
    """At most ``most`` of the triples of test set j, (N, 3), by a random stream whose seed is 0, a
    purpose and j.
    """
    if most is None or len(triples) <= most:
        return triples
    purpose = zlib.crc32(b"test triples of a snapshot")
    order = np.random.default_rng(np.random.SeedSequence([0, purpose, j]))
    return np.asarray(triples[np.sort(order.permutation(len(triples))[:most])])


def limits_of(i: int, j: int) -> dict[str, tuple[int, int]]:
    """By protocol, the snapshots whose entities are candidates, and whose facts are no errors."""
    of_lkge = {"lkge": (j, j), "incde": (j, j)}
    return of_lkge | {"revisiting": (i, j), "current": (i, i), "old": (i - 1, i)}


# Ranks


def ranked(graph: GrowingGraph, entity: np.ndarray, relation: np.ndarray, i: int) -> pd.DataFrame:
    """Ranks of the test sets 0 to i by the first embedding, for the entities of snapshot i: those
    after the first snapshot have the mean of the others. (With them, the mean of all stays the
    same.)

    Args:
        entity: table of the first embedding, shape (E, d).
        relation: its table of relations with their inverse ones, shape (R, 2d).

    Returns:
        Columns ``GROUP_OF_R``, ``lowest`` and ``highest``; a row for each query and protocol.
    """
    known = as_complex(entity)
    forward, inverse = map(as_complex, np.split(relation, 2, axis=1))
    new = graph.entities[i] - len(known)
    vectors = np.concatenate([known, np.tile(known.mean(0), (new, 1))])
    parts = []
    for j, (slot, given) in product(range(i + 1), OTHER_END.items()):
        if j in graph.unranked:
            continue
        triples = graph.tests[j]
        relations = forward if slot == "tail" else inverse
        mapped = vectors[triples[:, TRIPLE.index(given)]] * relations[triples[:, 1]]
        hidden = triples[:, TRIPLE.index(slot)]
        answers = graph.answers[j, slot]
        is_new = hidden >= (graph.entities[i - 1] if i else 0)
        kind = np.where(is_new, "new", "old")
        for start in range(0, len(triples), QUERIES_AT_ONCE):
            block = slice(start, start + QUERIES_AT_ONCE)
            wins = wins_of((mapped[block] @ vectors.conj().T).real, hidden[block])
            of_block = answers[answers["query"].between(start, block.stop - 1)]
            of_block = of_block.assign(query=of_block["query"] - start)
            ranks = ranks_of(wins, of_block, graph.entities, i, j)
            parts.append(ranks.assign(j=j, slot=slot, answer=kind[block][ranks["query"]]))
    return pd.concat(parts)


def as_complex(rows: np.ndarray) -> np.ndarray:
    """Rows of real halves and imaginary halves, (N, d), as complex numbers, (N, d / 2)."""
    real, imaginary = np.split(rows.astype(float), 2, axis=1)
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
    wins: np.ndarray, answers: pd.DataFrame, entities: list[int], i: int, j: int
) -> pd.DataFrame:
    """Ranks by protocol, from ``wins_of``, (2, Q, E), and the right answers of queries; columns
    ``protocol``, ``query``, ``lowest`` and ``highest``.

    The answer, too, is a right answer. It is tied with itself, and so does not count.
    """
    parts = []
    for protocol, (candidates, facts) in limits_of(i, j).items():
        if candidates < j:  # the answer may be no candidate
            continue
        number = entities[candidates]
        first = answers["in_lkge" if protocol == "lkge" else "arrival"]
        right = answers[(first <= facts) & (answers["answer"] < number)]
        ahead = wins[:, :, :number].sum(2)
        left_out = wins[:, right["query"], right["answer"]]
        for bound, of_answers in zip(ahead, left_out, strict=True):
            bound -= np.bincount(right["query"], of_answers, wins.shape[1])
        bounds = pd.DataFrame(1 + ahead.T, columns=["lowest", "highest"])
        parts.append(bounds.rename_axis("query").reset_index().assign(protocol=protocol))
    return pd.concat(parts)


def measures(ranks: pd.DataFrame, bound: str) -> pd.DataFrame:
    """The means of ``MEASURES`` by group of ``ranked``, of the ranks of a column."""
    rank = ranks[bound]
    of_each = {f"hits@{k}": rank <= k for k in HITS} | {"mrr": 1 / rank}
    groups = ranks[[*GROUP_OF_R]].assign(**of_each).groupby(GROUP_OF_R)
    return groups.mean().assign(queries=groups.size())


def check_matrix(experiment: str, settings: Values, check: Check) -> str:
    """Compare R[i, j] of the first embeddings, and of the chains that insert the mean, with the
    table of an experiment; returns what is left open.
    """
    graph = GrowingGraph(settings["timeline"], settings["most_tests"])
    steps, names = plain_steps(settings, len(graph.tests) - 1), ["initializer", "strategy"]
    matrix = table(f"continual/{experiment}/matrix")
    stored = matrix.assign(**matrix[names].fillna("")).merge(steps)
    stored = stored[~stored["j"].isin(graph.unranked)]
    first = load_file(f"data/continual/{experiment}/first.safetensors")
    widest = 0.0
    for seed, (entity, relation) in enumerate(zip(first["entity"], first["relation"], strict=True)):
        ranks = {i: ranked(graph, entity, relation, i) for i in steps["i"].unique()}
        highest, lowest = (
            pd.concat({i: measures(rows, bound) for i, rows in ranks.items()}, names=["i"])
            .reset_index()
            .merge(steps)
            .set_index([*STEP, *GROUP_OF_R])[MEASURES]
            for bound in ("lowest", "highest")
        )
        there = where(stored, seed=seed).set_index(lowest.index.names)
        check.compare(f"{experiment}, seed {seed}", lowest, there, highest)
        widest = max(widest, float((highest - lowest).to_numpy().max()))
    left_open = f"R[i, j] of {experiment}: rounding of scores leaves {widest:.0e} open at most"
    tests = ", ".join(map(str, graph.unranked))
    return f"{left_open}; test sets not ranked, for their new relations: {tests or 'none'}."


# What the report shows of a chain

#: Columns of its tables of graphs that grow that are computed again.
SHOWN = {
    "grown": [
        "new tests, at once", "new tests, after training",
        "base test, before", "base test, in the end", "D",
    ],
    "after_last": ["mrr", "hits@1", "hits@10"],
    "interference": ["H_old", "H_cur", "A_TN", "D"],
}  # fmt: skip


def mean_of(rows: pd.DataFrame, measure: str = "mrr") -> float:
    """Of a measure over all queries; NaN without any."""
    return float(np.average(rows[measure], weights=rows["queries"])) if len(rows) else np.nan


def measures_of(rows: pd.DataFrame, protocol: str) -> pd.Series:
    """All measures of ``SHOWN`` from a chain's rows of ``matrix.parquet``, in per cent: MRR of new
    tests and of the base test; means over all test sets after the last snapshot under a
    ``protocol``; and MEOR's H_old, H_cur, A_TN and D, means of MRR over updates and slots.
    """
    last = rows["i"].max()
    current = where(rows, protocol="current")
    of_new = current[(current["i"] == current["j"]) & (current["i"] > 0)]
    base = where(current, j=0, phase="trained")
    measures = {
        "new tests, at once": mean_of(where(of_new, phase="inserted")),
        "new tests, after training": mean_of(where(of_new, phase="trained")),
        "base test, before": mean_of(where(base, i=0)),
        "base test, in the end": mean_of(where(base, i=last)),
    }
    in_the_end = where(rows, protocol=protocol, phase="trained", i=last)
    tests = [where(in_the_end, j=j) for j in range(last + 1)]
    for name in SHOWN["after_last"]:
        measures[name] = float(np.mean([mean_of(test, name) for test in tests]))
    of_updates = []
    for i, slot in product(range(1, last + 1), OTHER_END):
        update = where(rows, phase="trained", i=i, slot=slot)
        earlier = update[update["j"] < i]
        parts = {
            "H_old": where(earlier, protocol="old"),
            "H_cur": where(earlier, protocol="current"),
            "A_TN": where(update, protocol="current", j=i, answer="new"),
        }
        of_updates.append({name: mean_of(part) for name, part in parts.items()})
    measures |= pd.DataFrame(of_updates).mean().to_dict()
    measures["D"] = measures["H_old"] - measures["H_cur"]
    return 100 * pd.Series(measures)


def check_published(experiment: str, settings: Values, check: Check) -> None:
    """Compare tables of the report of graphs that grow with what follows from R[i, j]: the
    experiment's own, and the lines of this run beside the numbers that others publish.
    """
    chains, matrix = chains_of(settings), table(f"continual/{experiment}/matrix")
    of_run = {"benchmark": settings["title"], "source": "this run"}
    for name, columns in SHOWN.items():
        if name == "grown":
            lines = shown(f"grown_{experiment}").assign(protocol="current")
        else:
            lines = where(shown(name), **of_run)
        for protocol, of_protocol in lines.groupby("protocol"):
            here = {}
            for initializer, strategy in chains:
                is_chain = (matrix["initializer"] == initializer) & (matrix["strategy"] == strategy)
                by_seed = matrix[is_chain | (matrix["i"] == 0)].groupby("seed")
                measures = [measures_of(rows, protocol)[columns] for _, rows in by_seed]
                here[f"{initializer} {strategy}"] = pd.DataFrame(measures).mean()
            ours = pd.DataFrame(here).T
            there = of_protocol.set_index(ours.index[: len(of_protocol)])
            check.compare(f"table {name}, {experiment}", ours, there)


def shown(name: str) -> pd.DataFrame:
    """A table of the report of graphs that grow; without rows if there is no such table."""
    path = Path(f"reports/continual/tables/{name}.csv")
    return pd.read_csv(path) if path.exists() else pd.DataFrame(columns=["benchmark", "source"])


def verify_grown(continual: Mapping[str, Values]) -> list[Check]:
    """Compare R[i, j] of the experiments that have run, and the report's tables; print what is
    skipped.
    """
    matrix, measured = Check("R[i, j]", 1e-6), Check("continual measures", 6e-3)
    have_run = [
        name for name in continual if Path(f"data/continual/{name}/matrix.parquet").exists()
    ]
    others = [name for name in have_run if continual[name]["model"] != MODEL]
    for experiment in have_run:
        if experiment not in others:
            print(check_matrix(experiment, continual[experiment], matrix))
        check_published(experiment, continual[experiment], measured)
    absent = [name for name in continual if name not in have_run]
    for names, reason in (
        (absent, "which have not run"),
        (others, f"of other models than {MODEL}"),
    ):
        if names:
            print(f"Not computed again: R[i, j] of {', '.join(names)}, {reason}.")
    return [matrix, measured]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "--points", type=int, default=12, help="grid points whose vectors are computed again"
    )
    number = parser.parse_args().points
    yaml = YAML(typ="safe", pure=True)
    have_grown = Path("data/continual").exists()
    checks = []
    try:
        if Path("data/graph").exists() or not have_grown:
            checks += verify(yaml.load(Path("params.yaml")), number)
        else:
            print("Not computed again: the first pipeline, which has not run.")
        if have_grown:
            checks += verify_grown(yaml.load(Path("continual/params.yaml"))["continual"])
        else:
            print("Not computed again: graphs that grow, which have not run.")
    except OSError as error:
        sys.exit(f"verify: {error}")
    titles = f"{'number':>9}{'largest difference':>20}{'tolerance':>11}{'disagreements':>15}"
    print(f"\n{'compared':18}{titles}", *checks, sep="\n")
    disagreements = [line for check in checks for line in check.disagreements]
    print(*disagreements[:20], sep="\n")
    sys.exit(bool(disagreements))


if __name__ == "__main__":
    main()
