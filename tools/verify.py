"""Recompute numbers of the pipelines and their reports from the pipelines' tables alone, and
compare.

A second, simple implementation of what docs/method.md defines, which uses no code of the library.
It computes mean epochs to convergence and, for ANALOGY alone, initial vectors of some initializers
and MRR* right after insertion at random grid points. Run it in the folder of dvc.yaml.
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


class Session:
    """Masks of the entities, (E,), and of the triples, (T,), at a grid point."""

    def __init__(self, experiment: Experiment, size: int, seed: int) -> None:
        self.experiment = experiment
        novel = where(experiment.novel, size=size, seed=seed)
        self.novel = where(novel, session=1)["entity"].to_numpy()
        later = novel.loc[novel["session"] > 1, "entity"]
        splits, ends = where(experiment.splits, seed=seed), experiment.triples[:, [0, 2]]
        split = np.full(len(ends), "", object)
        split[splits["triple"]] = splits["split"]
        split[np.isin(ends, later).any(1)] = ""
        self.train, self.valid, self.test = (split == name for name in SPLITS)
        self.is_old = ~np.isin(ends, self.novel).any(1)
        self.members = self.among(ends[splits["triple"]]) & ~self.among(later)
        self.known = self.members & ~self.among(self.novel)
        self.eligible = self.known & self.among(ends[self.train & self.is_old])
        self.inserted = where(experiment.insert_triples, size=size, seed=seed, session=1)

    def among(self, entities: Any) -> np.ndarray:
        return np.isin(np.arange(len(self.experiment.words)), entities)

    def scopes(self) -> dict[str, tuple[np.ndarray, np.ndarray, np.ndarray]]:
        """By scope: masks of queried triples, filtered triples, candidate entities."""
        learned, heldout = self.train | self.valid, self.valid | self.test
        is_given = np.isin(np.arange(len(self.train)), self.inserted["triple"])
        new = (learned | self.test) & ~self.is_old & ~is_given
        return {
            "all": (self.test, learned, self.members),
            "known": (self.test & self.is_old, learned, self.members),
            "known_closed": (self.test & self.is_old, learned, self.known),
            "novel": (new, (learned & self.is_old) | is_given, self.members),
            "novel_heldout": (heldout & ~self.is_old, self.train, self.members),
        }


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


# MRR* right after insertion


def terms(
    scores: np.ndarray,
    counts: np.ndarray,
    able: np.ndarray,
    answer: np.ndarray,
    tie: float,
) -> np.ndarray:
    """1 / (|R_G - R_P| + 1) of queries, (Q,); arrays, (Q, N), have a column for each entity or
    relation.
    """
    query = np.arange(len(answer))
    able[query, answer] = False
    ahead = scores - scores[query, answer][:, None]
    width = tie * np.abs(scores).max(1, keepdims=True)
    wins = np.where(ahead > width, 1.0, np.where(ahead < -width, 0.0, 0.5))
    of_answer = counts[query, answer][:, None]
    true_rank = (able & (counts > of_answer)).sum(1)
    predicted_rank = (wins * (able & (counts != of_answer))).sum(1)
    return np.asarray(1 / (abs(true_rank - predicted_rank) + 1))


def mrr_star(
    session: Session,
    scores: np.ndarray,
    scope: tuple[np.ndarray, np.ndarray, np.ndarray],
    tie: float = TIE,
) -> np.ndarray:
    """MRR*, entity half and relation half in [0, 1] of one scope (equation 7); NaN without queries.

    Args:
        scores: of all triples, shape (R, E, E): relation, head, tail; ``scope``: a value of
            ``Session.scopes``.
    """
    queried, filtered, candidates = scope
    triples, counts = session.experiment.triples, session.experiment.counts
    if not queried.any():
        return np.full(3, np.nan)
    able = np.ones(counts.shape, bool)
    barred, relation, barred_tail = triples[filtered].T
    able[relation, barred, barred_tail] = False
    head, relation, tail = triples[queried].T
    tables = scores, counts, able
    heads = [each[relation, :, tail] for each in tables]
    tails = [each[relation, head] for each in tables]
    relations = [each[:, head, tail].T.copy() for each in tables]
    heads[2] &= candidates
    tails[2] &= candidates
    of_ends = terms(*heads, head, tie) + terms(*tails, tail, tie)
    true = triples[session.train | session.valid | session.test]
    number = np.bincount(relation, minlength=len(counts))
    observed = np.bincount(true[:, 1], counts[true[:, 1], true[:, 0], true[:, 2]], len(counts))
    means = np.bincount(relation, of_ends / 2, len(counts))[number > 0] / number[number > 0]
    entity = np.average(means, weights=observed[number > 0])
    half = terms(*relations, relation, tie).mean()
    return np.array([(entity + half) / 2, entity, half])


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
        row = trained["seed"].tolist().index(seed)
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
        published = where(runs, size=size, seed=seed, session=1, epoch=0).set_index("scope")
        here = immediate_mrr_star(session, scores, published, immediate.tolerance)
        immediate.compare(place, here, published)
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


HALVES = ["mrr_star", "mrr_star_entity", "mrr_star_relation"]


def immediate_mrr_star(
    session: Session, scores: np.ndarray, published: pd.DataFrame, tolerance: float
) -> pd.DataFrame:
    """MRR* and its halves by scope.

    Rounding of scores decides which scores are tied. Where the ``published`` numbers differ, those
    of a tie width of 0.9 or 1.1 ``TIE`` may agree with them.
    """
    rows = {}
    for scope, masks in session.scopes().items():
        for share in (1, 0.9, 1.1):
            here = mrr_star(session, scores, masks, share * TIE)
            rows.setdefault(scope, here)
            if np.allclose(here, published.loc[scope, HALVES], 0, tolerance, equal_nan=True):
                rows[scope] = here
                break
    return pd.DataFrame.from_dict(rows, "index", columns=HALVES)


# Epochs to convergence


def check_epochs(experiment: Experiment, suffix: str, params: Values, check: Check) -> None:
    """Compare mean epochs and unconverged shares of the runs with Table 2."""
    margin, most = params["convergence"]["margin"], params["finetuning"]["max_epochs"]
    scopes = ["all", "novel_heldout"]
    table2 = pd.read_csv(f"reports/tables/table2_convergence{suffix}.csv")
    tuned = [model for model in experiment.initializers if experiment.runs[model]["epoch"].any()]
    titled = zip(table2["initializer"], tuned, strict=True)
    runs = pd.concat({title: experiment.runs[model] for title, model in titled})
    runs = runs[runs["scope"].isin(scopes)].rename_axis(["initializer", None]).reset_index(0)
    point = ["size", "seed", "session", "scope"]
    goal = experiment.runs["joint"].set_index(point)["mrr_star"] - margin
    runs = runs.join(goal.rename("goal"), on=point).set_index(["initializer", *point])
    measured = runs[runs["epoch"] == 0]["mrr_star"].dropna().index
    converged = runs[runs["mrr_star"] >= runs["goal"]]
    epochs = converged.groupby(level=[0, 1, 2, 3, 4])["epoch"].min().reindex(measured)
    each = pd.DataFrame({"mean": epochs.fillna(most), "unconverged %": 100 * epochs.isna()})
    of_all = each.groupby(["scope", "initializer"]).mean()
    for scope in scopes:
        columns = {f"{scope}: {name}": name for name in each}
        shown = table2.set_index("initializer")[list(columns)].rename(columns=columns)
        check.compare(f"{experiment.name}, scope {scope}", of_all.loc[scope], shown)


def verify(params: Values, number: int) -> list[Check]:
    """Compare random grid points, and epochs of experiments with one source;
    print which vectors are skipped.
    """
    experiments = []
    for name, settings in params["experiments"].items():
        listed = settings.get("initializers", "all")
        chosen = [key for key in params["initializers"] if listed == "all" or key in listed]
        experiments.append(Experiment(name, chosen))
    initial, immediate = Check("initial vectors", 1e-5), Check("immediate MRR*", 1e-5)
    epochs = Check("epochs", 6e-3)
    rng = np.random.default_rng(0)
    if params["embedding"]["model"] == "analogy":
        points = [
            (experiment, *point)
            for experiment in experiments
            for point in where(experiment.novel, session=1).groupby(["size", "seed"]).groups
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
            "Not computed again: vectors and MRR*, which this check "
            "recomputes only for the model ANALOGY."
        )
    for place, experiment in enumerate(experiments):
        if not params["experiments"][experiment.name]["graph"].get("extend"):
            check_epochs(experiment, f"_{experiment.name}" if place else "", params, epochs)
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
