"""Recompute numbers of the pipelines and their reports from the pipelines' tables alone, and
compare.

Code that shares nothing with the library computes mean epochs to convergence, MRR* under every
reading of the metric from the terms of single queries and, for ANALOGY alone, initial vectors of
some initializers and MRR* right after insertion at random grid points. Of graphs that grow, it
computes R[i, j] by the first embedding and by the mean of its vectors, for ComplEx alone, and what
the report shows of R. Run it in the folder of dvc.yaml.
"""

import argparse
import csv
import sys
from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import cycle
from pathlib import Path
from typing import Any

import numpy as np
from ruamel.yaml import YAML
from safetensors.numpy import load_file

from tools.recomputed import (
    RECOMPUTED,
    TIE,
    Around,
    Experiment,
    Ranked,
    Session,
    mrr_star,
    readings_there,
    seeds_of,
    there,
)
from tools.recomputed_matrix import (
    FirstEmbedding,
    GrowingGraph,
    MatrixTable,
    Settings,
    chains_of,
    plain_steps,
    published,
)

#: A novel entity is not compared if scores of the last indicator and of the next entity differ by
#: less than this.
UNDECIDED = 1e-5
#: The model of which R[i, j] is computed again.
MODEL = "complex"
#: Random seeds of a case whose readings are recomputed, with all of its models.
READING_SEEDS = 2
#: Bounds of the numbers of a row of R that is missing: no number lies between them.
NO_ROW = np.full(5, np.inf), np.full(5, np.inf)


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
        here, there = np.asarray(here, dtype=float), np.asarray(there, dtype=float)
        equal = here.shape == there.shape and (np.isnan(here) == np.isnan(there)).all()
        apart = float(np.nanmax(np.abs(here - there), initial=0.0)) if equal else np.inf
        self.worst = max(self.worst, apart)
        if apart > self.tolerance:
            most = (
                int(np.nan_to_num(np.abs(here - there), nan=np.inf).argmax())
                if here.shape == there.shape
                else 0
            )
            ours, theirs = here.flat[most], there.flat[most]
            self.disagreements.append(f"{self.about}, {where}: {ours:.6g} here, {theirs:.6g} there")


def check_cell(
    experiment: Experiment,
    size: int,
    seed: int,
    options: dict[str, Any],
    initial: Check,
    immediate: Check,
) -> int:
    """Compare initial vectors, and MRR* and its halves by model and scope;
    returns the number of vectors skipped.

    Rounding of scores decides which scores are tied, so MRR* may also agree with a tie width of 0.9
    or 1.1 ``TIE``.
    """
    session, row = Session(experiment, size, seed), experiment.row(size, seed)
    theta0 = load_file(f"data/embeddings/{experiment.name}/theta0/size={size:02d}.safetensors")
    joint = load_file(f"data/embeddings/{experiment.name}/joint.safetensors")
    left_open = 0
    for model in [*experiment.initializers, "joint"]:
        table, place = (
            (joint, joint["seed"].tolist().index(seed)) if model == "joint" else (theta0, row)
        )
        vectors, relations = (table[name][place].astype(float) for name in ("entity", "relation"))
        cell = f"{experiment.name}, size {size}, seed {seed}"
        if model != "joint":
            stored = load_file(f"data/runs/{experiment.name}/{model}.safetensors")[
                f"size={size:02d}"
            ][row]
            for entity, vector in zip(
                session.order if model in RECOMPUTED else (), stored, strict=False
            ):
                chosen, gap = RECOMPUTED[model](
                    Around(session, entity, vectors, relations), **options[model]
                )
                left_open += gap < UNDECIDED
                if gap >= UNDECIDED:
                    initial.compare(
                        f"{model}, {cell}, entity {entity}", vectors[sorted(chosen)].mean(0), vector
                    )
            vectors[session.order] = stored[: len(session.order)]
        # (R, heads, tails)
        scores = np.stack([there(vectors, relation) @ vectors.T for relation in relations])
        for name, scope in session.scopes().items():
            ((_, published),) = [
                run for run in experiment.runs[model][size, seed, 1, name] if run[0] == 0
            ]
            here = mrr_star(session, scores, scope)
            if not np.allclose(here, published, atol=immediate.tolerance, equal_nan=True):
                others = [mrr_star(session, scores, scope, share * TIE) for share in (0.9, 1.1)]
                here = min(
                    [here, *others], key=lambda way: np.abs(np.subtract(way, published)).max()
                )
            immediate.compare(f"{model}, scope {name}, {cell}", here, published)
    return left_open


def check_epochs(
    experiment: Experiment, suffix: str, params: dict[str, Any], mean: Check, share: Check
) -> None:
    """Compare mean epochs and unconverged shares of the runs with Table 2 and the table by size."""
    margin, most = params["convergence"]["margin"], params["finetuning"]["max_epochs"]
    shown, by_size = (
        list(
            csv.DictReader(
                Path(f"reports/tables/{table}{suffix}.csv").read_text(encoding="utf-8").splitlines()
            )
        )
        for table in ("table2_convergence", "convergence_by_size")
    )
    joint = experiment.runs["joint"]
    tuned = [
        name
        for name in experiment.initializers
        if any(len(run) > 1 for run in experiment.runs[name].values())
    ]
    for model, line in zip(tuned, shown, strict=True):
        epochs = {
            cell: min(
                (epoch for epoch, values in run if values[0] >= joint[cell][0][1][0] - margin),
                default=None,
            )
            for cell, run in experiment.runs[model].items()
            if cell[3] in ("all", "novel_heldout") and not np.isnan(run[0][1][0])
        }
        rows = [
            (scope, None, line[f"{scope}: mean"], line[f"{scope}: unconverged %"])
            for scope in ("all", "novel_heldout")
        ]
        rows += [
            (row["scope"], int(row["size"]), row["mean"], row["unconverged %"])
            for row in by_size
            if row["initializer"] == line["initializer"]
        ]
        for scope, size, mean_epochs, unconverged in rows:
            chosen = [
                e for cell, e in epochs.items() if cell[3] == scope and size in (None, cell[0])
            ]
            where = f"{model}, scope {scope}, {experiment.name}, size {size or 'any'}"
            mean.compare(
                where, np.mean([most if e is None else e for e in chosen]), mean_epochs or np.nan
            )
            share.compare(where, 100 * np.mean([e is None for e in chosen]), unconverged or np.nan)


def check_readings(case: str, check: Check, seeds: Sequence[int] = ()) -> None:
    """Compare MRR* under every reading in a case's table with that
    computed from its table of ranks, at some seeds, by default all.

    Among false candidates alone, the term of MRR* is also the reciprocal rank.
    """
    ranked, stored = Ranked(case, seeds), readings_there(case, seeds)
    computed = ranked.readings_here()
    for run in sorted({*computed, *stored}):
        model, k, size, seed = run
        here, there = computed.get(run, {}), stored.get(run, {})
        for group in sorted({*here, *there}):
            where = f"{' '.join(group)}, {model}, k {k}, {case}, size {size}, seed {seed}"
            check.compare(where, here.get(group, np.inf), there.get(group, np.inf))
    for truth in ("all", "split"):
        reciprocal = 1 / ranked.columns["rank_true"]
        check.compare(
            f"terms of {truth}, {case}", reciprocal, ranked.columns[f"closeness_true_{truth}"]
        )


def verify(params: dict[str, Any], number: int, seed: int) -> list[Check]:
    """Compare random grid points, and mean epochs of experiments with one source;
    print which vectors are skipped.
    """
    experiments = []
    for name, settings in params["experiments"].items():
        listed = settings.get("initializers", "all")
        experiments.append(
            Experiment(
                name, [key for key in params["initializers"] if listed == "all" or key in listed]
            )
        )
    checks = [
        Check("initial vectors", 1e-5),
        Check("immediate MRR*", 1e-5),
        Check("mean epochs", 6e-3),
        Check("unconverged %", 6e-3),
        Check("readings of MRR*", 1e-5),
    ]
    initial, immediate, epochs, unconverged, readings = checks
    cells = [
        (experiment, *cell[:2])
        for experiment in experiments
        for cell in experiment.novel
        if cell[2] == 1
    ]
    if params["embedding"]["model"] == "analogy":
        chosen = [
            cells[place] for place in np.random.default_rng(seed).permutation(len(cells))[:number]
        ]
        left_open = sum(
            check_cell(*cell, params["initializers"], initial, immediate) for cell in chosen
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
            check_epochs(
                experiment, f"_{experiment.name}" if place else "", params, epochs, unconverged
            )
    for path in sorted(Path("data/beyond/readings").glob("*.ranks.parquet")):
        case = path.name.removesuffix(".ranks.parquet")
        seeds = np.random.default_rng(seed).permutation(seeds_of(case))[:READING_SEEDS]
        check_readings(case, readings, seeds.tolist())
    return checks


def check_matrix(experiment: str, settings: Settings, check: Check) -> str:
    """Compare R[i, j] of the first embeddings, and of the chains that insert the mean, with the
    table of an experiment; returns what is left open.
    """
    graph, table = GrowingGraph(settings["timeline"]), MatrixTable.read(experiment)
    steps, most = plain_steps(settings, graph.last), settings["most_tests"]
    skipped, widest = set[int](), 0.0
    for seed, first in enumerate(FirstEmbedding.read(experiment)):
        skipped |= {j for j in range(len(graph.tests)) if not first.can_rank(graph.ranked(j, most))}
        rows = {i: first.matrix_row(graph, i, most) for i in {i for *_, i in steps}}
        for step in steps:
            initializer, strategy, phase, i = step
            chain = f"{initializer} {strategy}" if initializer else "first embedding"
            ours, theirs = rows[i], table.step(step, seed)
            groups = {*ours, *(group for group in theirs if group[1] not in skipped)}
            for group in sorted(groups):
                protocol, j, slot, kind = group
                where = f"{protocol}, {chain}, {phase}, {experiment}, seed {seed}, R[{i}, {j}]"
                lowest, highest = ours.get(group, NO_ROW)
                stored = theirs.get(group, NO_ROW[0])
                here = np.clip(stored, lowest, highest)
                check.compare(f"{where}, {slot}, {kind} answers", here, stored)
                if group in ours:
                    widest = max(widest, float((highest - lowest).max()))
    left_open = f"R[i, j] of {experiment}: rounding of scores leaves {widest:.0e} open at most"
    tests = ", ".join(map(str, sorted(skipped)))
    return f"{left_open}; test sets not ranked, for their new relations: {tests or 'none'}."


def check_published(experiment: str, settings: Settings, check: Check) -> None:
    """Compare the tables of the report of graphs that grow with what follows from R[i, j]."""
    table, chains = MatrixTable.read(experiment), chains_of(settings)
    grown = shown(f"grown_{experiment}")
    check.compare(f"lines of table grown, {experiment}", len(chains), len(grown))
    lines = [("grown", *line) for line in zip(chains, grown, strict=False)]
    # beside the numbers of each source that others publish: all strategies of an initializer
    beside = [chain for chain in chains if chain[0] == chains[0][0]]
    for name in ("after_last", "interference"):
        ours = [
            line
            for line in shown(name)
            if (line["benchmark"], line["source"]) == (settings["title"], "this run")
        ]
        lines += [(name, *line) for line in zip(cycle(beside), ours, strict=False)]
    for name, chain, line in lines:
        by_seed = [
            published(table.chain(*chain, seed), name, line)
            for seed in sorted(set(table.columns["seed"]))
        ]
        for column in by_seed[0]:
            here = np.mean([numbers[column] for numbers in by_seed])
            where = f"{column}, table {name}, {' '.join(chain)}, {experiment}"
            check.compare(where, here, line[column] or np.nan)


def shown(table: str) -> list[dict[str, str]]:
    """Lines of a table of the report of graphs that grow; none if there is no such table."""
    path = Path(f"reports/continual/tables/{table}.csv")
    if not path.exists():
        return []
    return list(csv.DictReader(path.read_text(encoding="utf-8").splitlines()))


def verify_grown(continual: dict[str, Settings]) -> list[Check]:
    """Compare R[i, j] of the experiments that have run, and the report's tables; print what is
    skipped.
    """
    matrix, measures = Check("R[i, j]", 1e-6), Check("continual measures", 6e-3)
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
            check_published(experiment, settings, measures)
    if absent:
        print(f"Not computed again: R[i, j] of {', '.join(absent)}, which have not run.")
    if others:
        print(f"Not computed again: R[i, j] of {', '.join(others)}, of other models than {MODEL}.")
    return [matrix, measures]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "--cells",
        type=int,
        default=12,
        help="grid points whose vectors and MRR* are computed again",
    )
    parser.add_argument("--seed", type=int, default=0, help="seed of the choice of grid points")
    given = parser.parse_args()
    yaml = YAML(typ="safe", pure=True)
    have_grown = Path("data/continual").exists()
    checks = []
    try:
        if Path("data/graph").exists() or not have_grown:
            checks += verify(yaml.load(Path("params.yaml")), given.cells, given.seed)
        else:
            print("Not computed again: the first pipeline, which has not run.")
        if have_grown:
            checks += verify_grown(yaml.load(Path("continual/params.yaml"))["continual"])
        else:
            print("Not computed again: graphs that grow, which have not run.")
    except OSError as error:
        sys.exit(f"verify: {error}")
    print(
        f"\n{'compared':18}{'number':>8}{'largest difference':>20}{'tolerance':>11}"
        f"{'disagreements':>15}"
    )
    for check in checks:
        numbers = (
            f"{check.number:8}{check.worst:20.1e}{check.tolerance:11.0e}"
            f"{len(check.disagreements):15}"
        )
        print(f"{check.about:18}{numbers}")
    for line in [line for check in checks for line in check.disagreements][:20]:
        print(line)
    sys.exit(any(check.disagreements for check in checks))


if __name__ == "__main__":
    main()
