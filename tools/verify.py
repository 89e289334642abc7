"""Recompute numbers of the pipelines and their reports from the pipelines' tables alone, and
compare.

A second, simple implementation of what docs/method.md and docs/continual.md define, which uses no
code of the library. It computes mean epochs to convergence, MRR* under every reading of the metric
from the terms of single queries and, for ANALOGY alone, initial vectors of some initializers and
MRR* right after insertion at random grid points. Of graphs that grow, it computes R[i, j] by the
first embedding and by the mean of its vectors, for ComplEx alone, and what the report shows of R.
Run it in the folder of dvc.yaml.
"""

from __future__ import annotations

import argparse
import sys
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import cycle, product
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
    """The comparison of recomputed numbers with those of a table."""

    about: str
    #: maximum absolute difference at which two numbers agree, in their unit
    tolerance: float
    number: int = 0
    worst: float = 0.0
    disagreements: list[str] = field(default_factory=list)

    def compare(self, where: str, here: Any, there: Any) -> None:
        """Compare two numbers or two arrays, and record a disagreement; two nulls agree."""
        self.number += 1
        here, there = np.asarray(here, float), np.asarray(there, float)
        apart = np.where(np.isnan(here) & np.isnan(there), 0, np.abs(here - there))
        apart = np.nan_to_num(apart, nan=np.inf, posinf=np.inf)
        self.worst = max(self.worst, float(apart.max(initial=0)))
        if (apart > self.tolerance).any():
            most = apart.argmax()
            both = f"{here.flat[most]:.6g} here, {there.flat[most]:.6g} there"
            self.disagreements.append(f"{self.about}, {where}: {both}")

    def __str__(self) -> str:
        numbers = f"{self.number:8}{self.worst:20.1e}{self.tolerance:11.0e}"
        return f"{self.about:18}{numbers}{len(self.disagreements):15}"


def table(path: str, seeds: Sequence[int] = ()) -> pd.DataFrame:
    """A table below ``data`` with plain values, of some ``seeds``, by default all."""
    filters = [("seed", "in", list(seeds))] if seeds else None
    frame = pd.read_parquet(Path("data", f"{path}.parquet"), filters=filters)
    return frame.astype(dict.fromkeys(frame.select_dtypes("category"), object))


def where(frame: pd.DataFrame, **values: Any) -> pd.DataFrame:
    """The rows with these values in their columns."""
    return frame[np.logical_and.reduce([frame[name] == value for name, value in values.items()])]


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
            there(vectors[head], relations[relation])
            if tail == entity
            else back(vectors[tail], relations[relation])
            for head, _, tail in triples[triples[:, 1] == relation]
        ]
        scores += unit(vectors) @ unit(np.mean(mapped, 0))
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
    model: str, session: Session, entity: int, tables: tuple[np.ndarray, np.ndarray], options: Any
) -> tuple[np.ndarray, float]:
    """The indicators of an initializer, and their gap as in ``best``."""
    words, relations = by_words(session, entity), by_relations(session, entity, *tables)
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

    Rounding of scores decides which scores are tied, so MRR* may also agree with a tie width of 0.9
    or 1.1 ``TIE``.
    """
    session, name = Session(experiment, size, seed), experiment.name
    point = f"{name}, size {size}, seed {seed}"
    theta0 = load_file(f"data/embeddings/{name}/theta0/size={size:02d}.safetensors")
    joint = load_file(f"data/embeddings/{name}/joint.safetensors")
    left_open = 0
    for model, runs in experiment.runs.items():
        trained = joint if model == "joint" else theta0
        row = trained["seed"].tolist().index(seed)
        vectors, relations = (trained[part][row].astype(float) for part in ("entity", "relation"))
        if model != "joint":
            stored = load_file(f"data/runs/{name}/{model}.safetensors")[f"size={size:02d}"][row]
            for entity, vector in zip(session.novel, stored, strict=False):
                if model not in RECOMPUTED:
                    break
                tables = vectors, relations
                chosen, gap = indicators(model, session, entity, tables, options[model])
                left_open += gap < UNDECIDED
                if gap >= UNDECIDED:
                    here = vectors[chosen].mean(0)
                    initial.compare(f"{model}, {point}, entity {entity}", here, vector)
            vectors[session.novel] = stored[: len(session.novel)]
        scores = np.stack([there(vectors, relation) @ vectors.T for relation in relations])
        first = where(runs, size=size, seed=seed, session=1, epoch=0).set_index("scope")
        for scope, masks in session.scopes().items():
            published = first.loc[scope, HALVES].to_numpy(float)
            here = mrr_star(session, scores, masks)
            if not np.allclose(here, published, atol=immediate.tolerance, equal_nan=True):
                others = [mrr_star(session, scores, masks, share * TIE) for share in (0.9, 1.1)]
                here = min([here, *others], key=lambda ours: np.abs(ours - published).max())
            immediate.compare(f"{model}, scope {scope}, {point}", here, published)
    return left_open


HALVES = ["mrr_star", "mrr_star_entity", "mrr_star_relation"]


# Epochs to convergence


def check_epochs(
    experiment: Experiment, suffix: str, params: Values, mean: Check, share: Check
) -> None:
    """Compare mean epochs and unconverged shares of the runs with Table 2 and the table by size."""
    margin, most = params["convergence"]["margin"], params["finetuning"]["max_epochs"]
    names, scopes = ("table2_convergence", "convergence_by_size"), ["all", "novel_heldout"]
    shown, by_size = (pd.read_csv(f"reports/tables/{name}{suffix}.csv") for name in names)
    point = ["size", "seed", "session", "scope"]
    goal = experiment.runs["joint"].set_index(point)["mrr_star"] - margin
    tuned = [model for model in experiment.initializers if experiment.runs[model]["epoch"].any()]
    for model, (_, line) in zip(tuned, shown.iterrows(), strict=True):
        runs = experiment.runs[model]
        runs = runs[runs["scope"].isin(scopes)].set_index(point)
        measured = runs[runs["epoch"] == 0]["mrr_star"].dropna().index
        runs = runs.join(goal.rename("goal"))
        converged = runs[runs["mrr_star"] >= runs["goal"]].groupby(point)["epoch"].min()
        epochs = converged.reindex(measured).reset_index()
        rows = [
            (scope, None, line[f"{scope}: mean"], line[f"{scope}: unconverged %"])
            for scope in scopes
        ]
        sizes = where(by_size, initializer=line["initializer"])
        rows += sizes[["scope", "size", "mean", "unconverged %"]].itertuples(index=False)
        for scope, size, mean_epochs, unconverged in rows:
            about = {"scope": scope} if size is None else {"scope": scope, "size": size}
            chosen = where(epochs, **about)["epoch"]
            place = f"{model}, scope {scope}, {experiment.name}, size {size or 'any'}"
            mean.compare(place, chosen.fillna(most).mean(), mean_epochs)
            share.compare(place, 100 * chosen.isna().mean(), unconverged)


# MRR* under every reading of the metric, from the terms of single queries

#: Choices of the splits that are queried, of the shares of slots, and of the triples that are no
#: candidates.
QUERIES = {"test": ["test"], "held_out": ["valid", "test"], "all": SPLITS, "train": ["train"]}
SLOTS = {
    "alike": {"head": 1 / 3, "relation": 1 / 3, "tail": 1 / 3},
    "entities": {"head": 1 / 2, "tail": 1 / 2},
    "halves": {"head": 1 / 4, "relation": 1 / 2, "tail": 1 / 4},
}
FILTERS, TRUTHS = ("learned", "true", "none"), ("all", "split")
ABOUT, WEIGHTS = ("any", "known", "novel", "both"), ("triple", "relation", "observations")
RUN, GROUP = ["model", "k", "size", "seed"], ["queries", "about", "weights"]
TERMS = pd.MultiIndex.from_product([FILTERS, TRUTHS], names=["filter", "truth"])
#: Random seeds of a case whose readings are recomputed, with all of its models.
READING_SEEDS = 2


def means_of(rows: pd.DataFrame, queries: str, about: str, weights: str) -> dict[str, np.ndarray]:
    """By slot, the means of the terms of a model at a grid point; shapes (filters · truths,)."""
    queried = rows["split"].isin(QUERIES[queries])
    if about in ("known", "novel"):
        queried &= (rows["novel"] == 1) == (about == "novel")
    tails = rows["hidden"] == "tail"
    observed = rows[tails].groupby("relation")["count"].sum()
    number = rows[tails & queried].groupby("relation").size()
    of_relation = rows["relation"].map(observed / number)
    weight = {"relation": of_relation, "observations": rows["count"]}.get(weights, queried * 1.0)
    means = {}
    for slot in ("head", "relation", "tail"):
        chosen = queried & (rows["hidden"] == slot)
        alike = (weights, slot) == ("relation", "relation")
        of_slot = np.ones(chosen.sum()) if alike else weight[chosen].to_numpy(float)
        total = of_slot.sum() if len(of_slot) else np.nan
        columns = [f"closeness_{name}_{truth}" for name, truth in TERMS]
        means[slot] = of_slot @ rows.loc[chosen, columns].to_numpy(float) / total
    return means


def readings_of(ranks: pd.DataFrame) -> pd.DataFrame:
    """MRR* by model, grid point and choices; a column for each filter and truth."""
    values = {}
    for run, rows in ranks.groupby(RUN):
        for group in product(QUERIES, ABOUT, WEIGHTS):
            means = means_of(rows, *group)
            for slots, shares in SLOTS.items():
                weighted = [share * means[slot] for slot, share in shares.items()]
                values[(*run, *group, slots)] = np.sum(weighted, 0)
    index = pd.MultiIndex.from_tuples(values, names=[*RUN, *GROUP, "slots"])
    return pd.DataFrame(list(values.values()), index, TERMS)


def check_readings(case: str, check: Check, seeds: Sequence[int] = ()) -> None:
    """Compare MRR* under every reading in a case's table with that
    computed from its table of ranks, at some seeds, by default all.

    Among false candidates alone, the term of MRR* is also the reciprocal rank.
    """
    ranks = table(f"beyond/readings/{case}.ranks", seeds)
    computed = readings_of(ranks)
    keys = [*RUN, *GROUP, "slots", "filter", "truth"]
    listed = table(f"beyond/readings/{case}", seeds).set_index(keys)["mrr_star"]
    stored = listed.unstack(["filter", "truth"], fill_value=np.inf)  # where a row is missing
    index = computed.index.union(stored.index)
    computed, stored = (
        each.reindex(index, fill_value=np.inf).reindex(columns=TERMS, fill_value=np.inf)
        for each in (computed, stored)
    )
    for place, here in computed.groupby(level=[*RUN, *GROUP]):
        model, k, size, seed, *group = place
        about = f"{' '.join(group)}, {model}, k {k}, {case}, size {size}, seed {seed}"
        check.compare(about, here, stored.loc[here.index])
    for truth in TRUTHS:
        reciprocal = 1 / ranks["rank_true"]
        check.compare(f"terms of {truth}, {case}", reciprocal, ranks[f"closeness_true_{truth}"])


def verify(params: Values, number: int, seed: int) -> list[Check]:
    """Compare random grid points, and mean epochs of experiments with one source;
    print which vectors are skipped.
    """
    experiments = []
    for name, settings in params["experiments"].items():
        listed = settings.get("initializers", "all")
        chosen = [key for key in params["initializers"] if listed == "all" or key in listed]
        experiments.append(Experiment(name, chosen))
    initial, immediate = Check("initial vectors", 1e-5), Check("immediate MRR*", 1e-5)
    epochs, unconverged = Check("mean epochs", 6e-3), Check("unconverged %", 6e-3)
    readings = Check("readings of MRR*", 1e-5)
    if params["embedding"]["model"] == "analogy":
        points = [
            (experiment, size, of_seed)
            for experiment in experiments
            for size, of_seed in where(experiment.novel, session=1)[["size", "seed"]]
            .drop_duplicates()
            .itertuples(index=False)
        ]
        places = np.random.default_rng(seed).permutation(len(points))[:number]
        left_open = sum(
            check_grid_point(*points[place], params["initializers"], initial, immediate)
            for place in places
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
            suffix = f"_{experiment.name}" if place else ""
            check_epochs(experiment, suffix, params, epochs, unconverged)
    for path in sorted(Path("data/beyond/readings").glob("*.ranks.parquet")):
        case = path.name.removesuffix(".ranks.parquet")
        seeds = sorted(set(table(f"beyond/readings/{case}")["seed"].tolist()))
        drawn = np.random.default_rng(seed).permutation(seeds)[:READING_SEEDS]
        check_readings(case, readings, drawn.tolist())
    return [initial, immediate, epochs, unconverged, readings]


# Graphs that grow: the graph and its queries

#: A difference of scores within this share of the limit of a tie may be either: the library's
#: numbers are float32.
ROUNDING = 1e-6
QUERIES_AT_ONCE = 500  #: Rows of one table of scores.
TRIPLE = ["head", "relation", "tail"]
#: By the slot that a query hides: the slot that it gives.
OTHER_END = {"head": "tail", "tail": "head"}
HITS = (1, 3, 10)
MEASURES = ["mrr", *(f"hits@{k}" for k in HITS)]
#: By benchmark, its column in data/raw/snapshots/triples.parquet.
LKGE = {name: f"lkge_{name.lower()}" for name in ("ENTITY", "RELATION", "FACT", "HYBRID")}
GRAPHS = {f"Graph{name}": f"graph_{name.lower()}" for name in ("Equal", "Higher", "Lower")}
COLUMNS = LKGE | GRAPHS | {f"FBinc-{size}": f"fbinc_{size.lower()}" for size in "SML"}
ABSENT = 255  #: In such a column: the triple takes no part.
MODEL = "complex"  #: The model of which R[i, j] is computed again.
#: Bounds of the numbers of a row of R that is missing: no number lies between them.
NO_ROW = np.full(5, np.inf), np.full(5, np.inf)

#: Of a row of ``matrix.parquet``: protocol, test set j, slot, kind of answer.
Group = tuple[str, int, str, str]
#: Of a part of a chain: initializer and strategy (both None: the first embedding), phase, i.
Step = tuple[str | None, str | None, str, int]


def chains_of(settings: Values) -> list[tuple[str, str]]:
    """Initializers with their strategies, in the order of params."""
    pairs, chains = settings["pairs"], []
    for initializer in settings["initializers"]:
        strategies = pairs if pairs == "all" else pairs.get(initializer, [])
        if strategies == "all":
            strategies = list(settings["strategies"])
        chains += [(initializer, strategy) for strategy in strategies]
    return chains


def plain_steps(settings: Values, last: int) -> list[Step]:
    """The parts of chains whose new vectors are the mean of the known ones, up to a ``last``
    snapshot. Whatever trains later, those of snapshot 1 are.
    """
    steps: list[Step] = [(None, None, "trained", 0)]
    parts_of = list(product(range(1, last + 1), ("inserted", "trained")))
    for initializer, strategy in chains_of(settings):
        plain = parts_of if strategy == "insert" else parts_of[:1]
        if initializer == "mean":
            steps += [(initializer, strategy, phase, i) for i, phase in plain]
    return steps


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

    def __init__(self, timeline: str) -> None:
        triples = triples_of(timeline)
        ends = pd.factorize(triples[["head", "tail"]].to_numpy(object).ravel())[0].reshape(-1, 2)
        relations = pd.factorize(triples["relation"])[0]
        triples = triples.assign(head=ends[:, 0], relation=relations, tail=ends[:, 1])
        snapshots = range(triples["snapshot"].max() + 1)
        known = [triples[triples["snapshot"] <= each] for each in snapshots]
        #: number of those known after each snapshot
        self.entities = [1 + int(each[["head", "tail"]].to_numpy().max()) for each in known]
        self.relations = [1 + int(each["relation"].max()) for each in known]
        tests = where(triples, split="test")
        #: shapes (N, 3)
        self.tests = [where(tests, snapshot=each)[TRIPLE].to_numpy() for each in snapshots]
        first = triples.groupby(TRIPLE)["snapshot"].min().rename("arrival")
        read = triples[triples["split"] != "valid"]  # what LKGE's code reads
        in_lkge = read.groupby(TRIPLE)["snapshot"].min().rename("in_lkge")
        #: the first snapshots that have a fact: in any split, and in those that LKGE's code reads
        self.facts = first.to_frame().join(in_lkge).fillna(np.inf).reset_index()
        self._answers: dict[tuple[int, str], pd.DataFrame] = {}

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

    def answers(self, j: int, slot: str, most: int | None) -> pd.DataFrame:
        """The right answers of the queries of test set j for a slot; columns ``query``, ``answer``,
        and the first snapshots as in ``facts``.
        """
        if (j, slot) not in self._answers:
            triples = pd.DataFrame(self.ranked(j, most), columns=TRIPLE).drop(columns=slot)
            asked = triples.assign(query=np.arange(len(triples)))
            answers = asked.merge(self.facts.rename(columns={slot: "answer"}))
            self._answers[j, slot] = answers.sort_values("query")
        return self._answers[j, slot]


def limits_of(i: int, j: int) -> dict[str, tuple[int, int]]:
    """By protocol, the snapshots whose entities are candidates, and whose facts are no errors."""
    of_lkge = {"lkge": (j, j), "incde": (j, j)}
    return of_lkge | {"revisiting": (i, j), "current": (i, i), "old": (i - 1, i)}


# Ranks


class FirstEmbedding:
    """The first embedding of a seed, by which R is computed."""

    def __init__(self, entity: np.ndarray, relation: np.ndarray) -> None:
        """Tables of entities, (E, d), and of relations with their inverse ones, (R, 2d)."""
        self.entity = as_complex(entity)  #: (E, d / 2)
        forward, inverse = np.split(relation, 2, axis=1)
        #: by the slot that a query hides; shapes (R, d / 2)
        self.relation = {"tail": as_complex(forward), "head": as_complex(inverse)}

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
        row = {}
        for j, (slot, other) in product(range(i + 1), OTHER_END.items()):
            triples = graph.ranked(j, most)
            if not len(triples) or not self.can_rank(triples):
                continue
            hidden, given = triples[:, TRIPLE.index(slot)], triples[:, TRIPLE.index(other)]
            vectors = self.with_means(graph.entities[i])
            mapped = vectors[given] * self.relation[slot][triples[:, 1]]
            answers, blocks = graph.answers(j, slot, most), []
            for start in range(0, len(triples), QUERIES_AT_ONCE):
                block = slice(start, start + QUERIES_AT_ONCE)
                wins = wins_of((mapped[block] @ vectors.conj().T).real, hidden[block])
                of_block = answers["query"].between(start, block.stop - 1)
                of_block = answers[of_block].assign(query=answers["query"] - start)
                blocks.append(ranks_of(wins, of_block, graph.entities, i, j))
            is_new = hidden >= (graph.entities[i - 1] if i else 0)
            for protocol, kind in product(blocks[0], ("new", "old")):
                chosen = is_new == (kind == "new")
                ranks = np.concatenate([block[protocol] for block in blocks], axis=1)[:, chosen]
                if chosen.any():
                    lowest, highest = ranks
                    row[protocol, j, slot, kind] = measures(highest), measures(lowest)
        return row

    def can_rank(self, triples: np.ndarray) -> bool:
        """Whether all relations of triples, (N, 3), are those of the first snapshot: a later one
        is fitted.
        """
        return bool((triples[:, 1] < len(self.relation["tail"])).all())


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
) -> dict[str, np.ndarray]:
    """Ranks by protocol, (2, Q), from ``wins_of``, (2, Q, E), and the right answers of queries.

    The answer, too, is a right answer. It is tied with itself, and so does not count.
    """
    ranks = {}
    for protocol, (candidates, facts) in limits_of(i, j).items():
        if candidates < j:  # the answer may be no candidate
            continue
        number = entities[candidates]
        first = answers["in_lkge" if protocol == "lkge" else "arrival"]
        right = answers[(first <= facts) & (answers["answer"] < number)]
        left_out = wins[:, right["query"], right["answer"]]
        ahead = wins[:, :, :number].sum(2)
        for bound, of_answers in zip(ahead, left_out, strict=True):
            bound -= np.bincount(right["query"], of_answers, wins.shape[1])
        ranks[protocol] = 1 + ahead
    return ranks


def measures(ranks: np.ndarray) -> np.ndarray:
    """The number of queries and ``MEASURES`` of ranks, (Q,); shape (5,)."""
    hits = [(ranks <= k).mean() for k in HITS]
    return np.array([len(ranks), (1 / ranks).mean(), *hits])


def of_step(matrix: pd.DataFrame, step: Step, seed: int) -> dict[Group, np.ndarray]:
    """The numbers of queries and ``MEASURES`` of a part of a chain; shapes (5,)."""
    initializer, strategy, phase, i = step
    chain = {"initializer": initializer, "strategy": strategy} if initializer else {}
    rows = where(matrix, seed=seed, phase=phase, i=i, **chain)
    groups = rows[["protocol", "j", "slot", "answer"]].itertuples(index=False, name=None)
    return dict(zip(groups, rows[["queries", *MEASURES]].to_numpy(float), strict=True))


def check_matrix(experiment: str, settings: Values, check: Check) -> str:
    """Compare R[i, j] of the first embeddings, and of the chains that insert the mean, with the
    table of an experiment; returns what is left open.
    """
    graph, matrix = GrowingGraph(settings["timeline"]), table(f"continual/{experiment}/matrix")
    steps, most = plain_steps(settings, graph.last), settings["most_tests"]
    skipped, widest = set[int](), 0.0
    for seed, first in enumerate(FirstEmbedding.read(experiment)):
        skipped |= {j for j in range(len(graph.tests)) if not first.can_rank(graph.ranked(j, most))}
        rows = {i: first.matrix_row(graph, i, most) for i in {i for *_, i in steps}}
        for step in steps:
            initializer, strategy, phase, i = step
            chain = f"{initializer} {strategy}" if initializer else "first embedding"
            ours, theirs = rows[i], of_step(matrix, step, seed)
            groups = {*ours, *(group for group in theirs if group[1] not in skipped)}
            for group in sorted(groups):
                protocol, j, slot, kind = group
                place = f"{protocol}, {chain}, {phase}, {experiment}, seed {seed}, R[{i}, {j}]"
                lowest, highest = ours.get(group, NO_ROW)
                stored = theirs.get(group, NO_ROW[0])
                here = np.clip(stored, lowest, highest)
                check.compare(f"{place}, {slot}, {kind} answers", here, stored)
                if group in ours:
                    widest = max(widest, float((highest - lowest).max()))
    left_open = f"R[i, j] of {experiment}: rounding of scores leaves {widest:.0e} open at most"
    tests = ", ".join(map(str, sorted(skipped)))
    return f"{left_open}; test sets not ranked, for their new relations: {tests or 'none'}."


# What the report shows of a chain, from its rows of ``matrix.parquet``; per cent


def mean_of(rows: pd.DataFrame, measure: str = "mrr") -> float:
    """Of a measure over all queries; NaN without any."""
    return float(np.average(rows[measure], weights=rows["queries"])) if len(rows) else np.nan


def grown(rows: pd.DataFrame) -> dict[str, float]:
    """MRR of new tests and of the base test, and D."""
    current = where(rows, protocol="current")
    of_new = current[(current["i"] == current["j"]) & (current["i"] > 0)]
    base = where(current, j=0, phase="trained")
    means = {
        "new tests, at once": mean_of(where(of_new, phase="inserted")),
        "new tests, after training": mean_of(where(of_new, phase="trained")),
        "base test, before": mean_of(where(base, i=0)),
        "base test, in the end": mean_of(where(base, i=rows["i"].max())),
    }
    of_meor = interference(rows)
    return {name: 100 * value for name, value in means.items()} | {"D": of_meor["D"]}


def after_last(rows: pd.DataFrame, protocol: str) -> dict[str, float]:
    """Means of MRR, hits@1 and hits@10 over all test sets after the last snapshot."""
    in_the_end = where(rows, protocol=protocol, phase="trained", i=rows["i"].max())
    tests = [where(in_the_end, j=j) for j in range(rows["i"].max() + 1)]
    names = ("mrr", "hits@1", "hits@10")
    return {name: float(100 * np.mean([mean_of(test, name) for test in tests])) for name in names}


def interference(rows: pd.DataFrame) -> dict[str, float]:
    """MEOR's H_old, H_cur, D and A_TN: means of MRR over updates and slots."""
    values = []
    for i, slot in product(range(1, rows["i"].max() + 1), OTHER_END):
        update = where(rows, phase="trained", i=i, slot=slot)
        earlier = update[update["j"] < i]
        of_protocol = [mean_of(where(earlier, protocol=name)) for name in ("old", "current")]
        new = mean_of(where(update, protocol="current", j=i, answer="new"))
        values.append([*of_protocol, new])
    old, current, new = (100 * np.nanmean(values, axis=0)).tolist()
    return {"H_old": old, "H_cur": current, "A_TN": new, "D": old - current}


def check_published(experiment: str, settings: Values, check: Check) -> None:
    """Compare the tables of the report of graphs that grow with what follows from R[i, j]."""
    matrix, chains = table(f"continual/{experiment}/matrix"), chains_of(settings)
    lines = list(zip(cycle(["grown"]), chains, shown(f"grown_{experiment}"), strict=False))
    check.compare(f"lines of table grown, {experiment}", len(chains), len(lines))
    # beside the numbers of each source that others publish: all strategies of an initializer
    beside = [chain for chain in chains if chain[0] == chains[0][0]]
    for name in ("after_last", "interference"):
        ours = [
            line
            for line in shown(name)
            if (line["benchmark"], line["source"]) == (settings["title"], "this run")
        ]
        lines += zip(cycle([name]), cycle(beside), ours, strict=False)
    for name, (initializer, strategy), line in lines:
        is_chain = (matrix["initializer"] == initializer) & (matrix["strategy"] == strategy)
        by_seed = []
        for _, rows in matrix[is_chain | (matrix["i"] == 0)].groupby("seed"):
            if name == "after_last":
                by_seed.append(after_last(rows, line["protocol"]))
            else:
                by_seed.append(grown(rows) if name == "grown" else interference(rows))
        for column, here in pd.DataFrame(by_seed).mean().items():
            place = f"{column}, table {name}, {initializer} {strategy}, {experiment}"
            check.compare(place, here, line[column])


def shown(name: str) -> list[dict[Any, Any]]:
    """Lines of a table of the report of graphs that grow; none if there is no such table."""
    path = Path(f"reports/continual/tables/{name}.csv")
    return pd.read_csv(path).to_dict("records") if path.exists() else []


def verify_grown(continual: Mapping[str, Values]) -> list[Check]:
    """Compare R[i, j] of the experiments that have run, and the report's tables; print what is
    skipped.
    """
    matrix, measured = Check("R[i, j]", 1e-6), Check("continual measures", 6e-3)
    absent, others = list[str](), list[str]()
    for experiment, settings in continual.items():
        if not Path(f"data/continual/{experiment}/matrix.parquet").exists():
            absent.append(experiment)
            continue
        if settings["model"] == MODEL:
            print(check_matrix(experiment, settings, matrix))
        else:
            others.append(experiment)
        if shown(f"grown_{experiment}"):
            check_published(experiment, settings, measured)
    if absent:
        print(f"Not computed again: R[i, j] of {', '.join(absent)}, which have not run.")
    if others:
        print(f"Not computed again: R[i, j] of {', '.join(others)}, of other models than {MODEL}.")
    return [matrix, measured]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "--cells", type=int, default=12, help="grid points whose vectors are computed again"
    )
    parser.add_argument("--seed", type=int, default=0, help="seed of the choice of grid points")
    options = parser.parse_args()
    yaml = YAML(typ="safe", pure=True)
    have_grown = Path("data/continual").exists()
    checks = []
    try:
        if Path("data/graph").exists() or not have_grown:
            checks += verify(yaml.load(Path("params.yaml")), options.cells, options.seed)
        else:
            print("Not computed again: the first pipeline, which has not run.")
        if have_grown:
            checks += verify_grown(yaml.load(Path("continual/params.yaml"))["continual"])
        else:
            print("Not computed again: graphs that grow, which have not run.")
    except OSError as error:
        sys.exit(f"verify: {error}")
    titles = f"{'number':>8}{'largest difference':>20}{'tolerance':>11}{'disagreements':>15}"
    print(f"\n{'compared':18}{titles}", *checks, sep="\n")
    disagreements = [line for check in checks for line in check.disagreements]
    print(*disagreements[:20], sep="\n")
    sys.exit(bool(disagreements))


if __name__ == "__main__":
    main()
