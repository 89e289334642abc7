"""Recompute numbers of the pipelines and their reports from the pipelines' tables alone, and
compare.

A second, simple implementation of what docs/method.md defines, which uses no code of the library.
It computes epochs to convergence and, for ANALOGY alone, initial vectors of some initializers and
the measure right after insertion at random grid points. Run it in the folder of dvc.yaml.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
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

    def compare(self, place: str, here: pd.DataFrame, there: Any) -> None:
        """Compare the rows of two tables by their index, and record those that disagree. Two nulls
        agree; a row that one table lacks disagrees.

        Args:
            there: has the columns of ``here``, and may have others.
        """
        index = here.index.union(there.index, sort=False)
        ours, numbers = (
            each[here.columns].astype(float).reindex(index, fill_value=np.inf).to_numpy()
            for each in (here, there)
        )
        apart = np.abs(ours - numbers)
        apart = np.where(np.isnan(ours) & np.isnan(numbers), 0, apart)
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
            both = f"{ours[row, column]:.6g} here, {numbers[row, column]:.6g} there"
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

    def scopes(self) -> dict[str, ScopeQueries]:
        """What the measure asks, by scope; ``weighted`` follows from two of them."""
        learned, heldout = self.train | self.valid, self.valid | self.test
        is_given = np.isin(np.arange(len(self.train)), self.inserted["triple"])
        head, relation, tail = self.experiment.triples.T
        times = np.where(self.train, self.experiment.counts[relation, head, tail], 1)
        new = (learned | self.test) & ~self.is_old & ~is_given
        old = self.test & self.is_old
        before, held_out = learned & self.is_old, self.test & ~is_given
        return {
            "known": ScopeQueries(old, before, self.members),
            "known_closed": ScopeQueries(old, before, self.known),
            "novel": ScopeQueries(times * new, before, self.members),
            "held_out": ScopeQueries(held_out, learned, self.members),
            "novel_held_out": ScopeQueries(
                heldout & ~self.is_old & ~is_given, self.train, self.members
            ),
        }


@dataclass
class ScopeQueries:
    """The queries of a scope: how often each triple is queried, (T,); the triples of the filter of
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


def measures(
    session: Session, scores: np.ndarray, queries: ScopeQueries, tie: float = TIE
) -> np.ndarray:
    """``MEASURES`` in [0, 1] of one scope; NaN without queries.

    Args:
        scores: of all triples, shape (R, E, E): relation, head, tail.
    """
    triples, counts = session.experiment.triples, session.experiment.counts
    if not queries.times.any():
        return np.full(6, np.nan)
    true = session.train | session.valid | session.test
    able = []
    for barred in (queries.filtered, true):
        head, relation, tail = triples[barred].T
        allowed = np.ones(counts.shape, bool)
        allowed[relation, head, tail] = False
        able.append(allowed)
    times = queries.times[queries.times > 0].astype(float)
    head, relation, tail = triples[queries.times > 0].T
    places = {"head": (relation, slice(None), tail), "tail": (relation, head)}
    by_end = {}
    for end, answer in (("head", head), ("tail", tail)):
        at = places[end]
        allowed = tuple(each[at] & queries.candidates for each in able)
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
    has_queries = number > 0
    values = []
    for which in (0, 1):
        of_ends = times * (by_end["head"][which] + by_end["tail"][which]) / 2
        means = np.bincount(relation, of_ends, len(counts))[has_queries] / number[has_queries]
        entity = np.average(means, weights=seen[has_queries])
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
    for scope, queries in session.scopes().items():
        for share in (1, 0.9, 1.1):
            here = measures(session, scores, queries, share * TIE)
            rows.setdefault(scope, here)
            if np.allclose(here, there.loc[scope, MEASURES], 0, tolerance, equal_nan=True):
                rows[scope] = here
                break
    return pd.DataFrame.from_dict(rows, "index", columns=MEASURES)


# Epochs to convergence

#: Columns of Table 2: mean over all runs, mean over those that end, and how many do not.
EPOCHS = ["mean", "runs that end: mean", "do not end"]


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
    return pd.DataFrame.from_dict(rows, "index", columns=EPOCHS)


def check_epochs(experiment: Experiment, params: Values, check: Check) -> None:
    """Compare epochs to convergence with Table 2, which has the same initializers in order."""
    settings = params["experiments"][experiment.name]
    most = {**params["finetuning"], **(settings["finetuning"] or {})}["max_epochs"]
    margin, seeds = params["convergence"]["margin"], settings["finetuned"]["seeds"]
    here = epochs_of(experiment, seeds, margin, most)
    table2 = pd.read_csv("reports/tables/table2_convergence.csv")
    table2 = table2[table2["graph"] == settings["title"]]
    check.compare(experiment.name, here, table2.set_index(here.index)[EPOCHS])


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


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "--points", type=int, default=12, help="grid points whose vectors are computed again"
    )
    number = parser.parse_args().points
    yaml = YAML(typ="safe", pure=True)
    try:
        checks = verify(yaml.load(Path("params.yaml")), number)
    except OSError as error:
        sys.exit(f"verify: {error}")
    titles = f"{'number':>9}{'largest difference':>20}{'tolerance':>11}{'disagreements':>15}"
    print(f"\n{'compared':18}{titles}", *checks, sep="\n")
    disagreements = [line for check in checks for line in check.disagreements]
    print(*disagreements[:20], sep="\n")
    sys.exit(bool(disagreements))


if __name__ == "__main__":
    main()
