"""The graphs, the choices of this run against others, and what was run and left out."""

import platform
import subprocess
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from importlib.metadata import version
from math import nan
from typing import Any

import numpy as np
import pandas as pd

from stages.files import OBSERVATIONS
from stages.projection import Projection
from stages.report.scopes import GROUPED
from stages.report.tables.data import Experiment, Results
from stages.report.tables.estimates import MEASURES, TableRow, bounded, over_seeds, under, where
from stages.report.tables.forms import ANY_SIZE
from stages.report.tables.registry import of_each, table
from stages.report.tables.statistics import best_indicators, right_after
from stages.trace_trajectory import TRAJECTORY

#: The paper's rule: average epochs over NEIGHBOURS neighbouring sizes; grow while the average falls
#: by at least EPOCHS and MRR, in [0, 1], is at most LOSS below the best.
NEIGHBOURS, EPOCHS, LOSS = 3, 1.0, 0.01
_PACKAGES = (
    "dvc",
    "gensim",
    "matplotlib",
    "numpy",
    "pandas",
    "procthor",
    "pyarrow",
    "scipy",
    "torch",
)
#: What the results of a run depend on, as paths of git.
CODE = ("isi", "stages", "data/raw", "params.yaml", "beyond/params.yaml")
#: Sections of params that the table of the run omits.
UNUSED = {"compute", "recorder", "plots", "finetune_only", "final_model"}


def in_order(values: Iterable[Any], first: Sequence[str]) -> list[str]:
    """Values in the order of ``first``, then the others in their own order."""
    present = list(values)
    known = [value for value in first if value in present]
    return known + [value for value in present if value not in first]


# The graphs


@table("report")
def graph_totals(results: Results) -> pd.DataFrame:
    """Counts of each graph beside those that the paper states."""
    paper, columns = results.paper["graph"], dict[str, dict[Any, int]]()
    for experiment in results.standalone:
        entities, triples = experiment.entities, experiment.triples
        kinds = entities["kind"].value_counts()
        columns[experiment.title] = {
            "observations": int(triples["count"].sum()),
            "unique_triples": len(triples),
            "relations": triples["relation"].nunique(),
            "entities": len(entities),
            **{str(kind): int(number) for kind, number in kinds.items()},
        }
    frame = pd.DataFrame(columns)
    kind_names = [name for name in results.vocabulary["kinds"] if name in frame.index]
    totals = ["observations", "unique_triples", "relations", "entities"]
    frame = frame.loc[in_order(frame.index, [*totals, *kind_names])]
    frame.insert(0, "paper", [paper.get(name) for name in frame.index])
    titles = {kind: f"{kind} entities" for kind in kind_names}
    frame.index = [titles.get(name, name.replace("_", " ")) for name in frame.index]
    return frame.rename_axis("").reset_index()


@table("report")
def table1_graph_statistics(results: Results) -> pd.DataFrame | None:
    """Table 1: median counts per environment by room type, beside the paper's, of the first graph
    whose observations name their environments.
    """
    paper = results.paper["graph"]["median_per_environment"]
    for experiment in results.standalone:
        observations = OBSERVATIONS.read_text(source=experiment.settings.graph.source)
        if observations["scene"].notna().any():
            return table1(observations, paper, results.vocabulary)
    return None


def table1(
    observations: pd.DataFrame, paper: Mapping[str, Any], vocabulary: Mapping[str, Any]
) -> pd.DataFrame:
    """Median counts per environment by room type; relations have the paper's titles."""
    rows, words = observations[observations["scene"].notna()], vocabulary["relations"]
    counts = rows.groupby(["scene", "relation"]).size().unstack(fill_value=0)
    counts = counts[in_order(counts.columns, list(words))].rename(columns=words)
    counts["object types"] = rows.groupby("scene")["head"].nunique()
    counts["room"] = rows.groupby("scene")["room"].first()
    rooms = pd.concat([counts, counts.assign(room="all")]).groupby("room")
    ours = rooms.median().assign(rooms=rooms.size())
    ours = ours.loc[[*in_order(ours.index.drop("all"), list(paper)), "all"]]
    theirs, frame = pd.DataFrame(paper).T.reindex(ours.index), pd.DataFrame(index=ours.index)
    for name in ours:
        title = "entities" if name == "object types" else str(name)
        frame[name] = ours[name].astype(float)
        frame[f"{title} (paper)"] = theirs.get(title, np.nan)
    return frame.dropna(axis=1, how="all").reset_index()


# Training and choices


def by_indicators(results: Results, experiment: Experiment) -> pd.DataFrame | None:
    """Means of the sweep by model and k: the measure (points) right after insertion by group, and
    epochs to convergence of the sets that are fine-tuned.
    """
    sweep = experiment.sweep
    if sweep is None:
        return None
    by, now = ["model", "k"], where(sweep, epoch=0)
    parts = [
        under(over_seeds(where(now, scope=scope), by, {"mrr": "MRR"}), scope) for scope in GROUPED
    ]
    seeds = results.params.sweep.finetuned_seeds
    epochs = experiment.converged(sweep, by, seeds)
    parts.append(over_seeds(epochs, by, {"epochs": "epochs"}, scale=1, least=0))
    groups = epochs.groupby(by)["converged"]
    parts.append((groups.size() - groups.sum()).rename("do not end").to_frame())
    return pd.concat(parts, axis=1)


@table("report")
@of_each("standalone")
def sensitivity(results: Results, experiment: Experiment) -> pd.DataFrame | None:
    """Sensitivity to the indicator set size (Figures 2a and 2b)."""
    means = by_indicators(results, experiment)
    if means is None:
        return None
    models = list(results.params.sweep.initializers)
    frame = results.models.in_rows(means, models, "initializer")
    return frame.rename(columns={"k": "indicators"})


@table("report")
@of_each("standalone")
def indicator_sizes(results: Results, experiment: Experiment) -> pd.DataFrame | None:
    """The number of indicators with the highest measure right after insertion, with its interval;
    what more of them change; and the number that the paper's rule picks.
    """
    sweep, means = experiment.sweep, by_indicators(results, experiment)
    if sweep is None or means is None:
        return None
    paper, options, rows = results.paper, results.params.initializers, list[TableRow]()
    for model in results.params.sweep.initializers:
        of_model = means.loc[model]
        values, epochs = of_model["weighted: MRR"], of_model["epochs"]
        best = best_indicators(right_after(sweep, model))
        row: TableRow = {"initializer": results.models.labels[model]} | bounded("best k", best)
        if experiment is results.on(papers=True):
            row["best k: paper"] = paper["indicators_degrade_after"]
        row["MRR at the best k"] = values.max()
        row["MRR at the largest k"] = values.iloc[-1]
        row["epochs at the smallest k"] = epochs.iloc[0]
        row["epochs at the largest k"] = epochs.iloc[-1]
        row["picked by the rule"] = select_size(
            list(values.index), (values / 100).tolist(), epochs.tolist()
        )
        row["picked by the paper"] = paper["indicators"].get(model, nan)
        row["params"] = options.get(model, {}).get("k", nan)
        rows.append(row)
    return pd.DataFrame(rows)


def select_size(sizes: Sequence[int], values: Sequence[float], epochs: Sequence[float]) -> int:
    """The indicator set size that the paper's rule picks (section 5.3).

    The paper "increased the indicator set size while the average number of epochs for three
    neighboring sizes decreased by 1 epoch or the MRR* went 1% point below the best performance". We
    grow while the average falls, and stop before MRR* is too low. Neighbours are those in the list:
    the average is first compared between the second and the third size, and the last size is never
    picked. The best performance is the best among smaller sizes. The first size is picked if MRR*
    of the second is too low, or if there are fewer than three sizes.

    Sizes ascend; ``values`` are MRR in [0, 1], right after insertion, ``epochs`` the mean epochs to
    convergence, by size.
    """
    means = [sum(epochs[place - 1 : place + 2]) / NEIGHBOURS for place in range(1, len(sizes) - 1)]
    picked = 0
    for place in range(1, len(sizes) - 1):
        # NaN counts as no gain
        no_gain = place > 1 and not means[place - 2] - means[place - 1] >= EPOCHS
        if no_gain or values[place] < max(values[:place]) - LOSS:
            break
        picked = place
    return sizes[picked]


@table("report")
def cross_validation(results: Results) -> pd.DataFrame | None:
    """A row for each setting, this run's first: mean and deviation of MRR over folds, and whose
    choice it is.
    """
    folds = (experiment.folds for experiment in results.standalone)
    rows = next((each for each in folds if each is not None), None)
    settings = [setting.model_dump() for setting in results.params.settings]
    choice = settings[0]
    means = None if rows is None else by_setting(rows, choice)
    if means is None:
        return None
    frame = pd.DataFrame(settings).join(means, on=list(choice))
    frame["beyond the folds' deviation"] = np.where(frame.pop("within"), "no", "yes")
    frame.loc[0, "beyond the folds' deviation"] = ""
    chosen = {"this run": choice, "paper": results.paper["training"]}
    frame["choice of"] = [
        ", ".join(who for who, best in chosen.items() if setting == best) for setting in settings
    ]
    frame = frame.rename(columns={name: name.replace("_", " ") for name in choice})
    frame.attrs[ANY_SIZE] = list(frame)[: len(choice)]
    return frame


def by_setting(rows: pd.DataFrame, choice: Mapping[str, float]) -> pd.DataFrame | None:
    """Means over folds, and the deviation of MRR (points), by setting; MRR ``from the choice``, and
    whether this is ``within`` the larger of the two deviations; None without the choice.
    """
    groups = rows.groupby(list(choice))
    measures = 100 * groups[list(MEASURES)].mean().rename(columns=MEASURES)
    measures.insert(1, "std", 100 * groups["mrr"].std())
    measures["best epoch"] = groups["epoch"].mean()
    place = tuple(choice.values())
    if place not in measures.index:
        return None
    lead = measures["MRR"] - measures["MRR"][place]
    spread = measures["std"].clip(lower=measures["std"][place])
    return measures.assign(**{"from the choice": lead, "within": lead.abs() < spread})


# One insertion (Figure 1)


@table("report")
def figure1_trajectory(results: Results) -> pd.DataFrame | None:
    """The places of Figure 1: the path of one novel entity through fine-tuning."""
    traced = results.params.trajectory.experiments
    first = next((each for each in results.experiments if each.name in traced), None)
    if first is None:
        return None
    file = TRAJECTORY.path(experiment=first.name)
    if not file.exists():
        return None
    traces = {name: tensor.numpy() for name, tensor in TRAJECTORY.read_file(file).items()}
    known = traces["theta0"][traces["known"].astype(bool)]  # [N, d]
    plane = Projection.of(known)
    places = [_places(plane.places(known), "", "known entity")]
    for model in first.initializers:
        if f"{model}.path" not in traces:
            continue
        chosen = traces[f"{model}.indicators"].astype(bool)
        label = results.models.labels[model]
        if chosen.any() and model in first.methods:
            places.append(_places(plane.places(traces["theta0"][chosen]), label, "indicator"))
        vectors = traces[f"{model}.path"].astype(np.float64)
        places.append(_places(plane.places(vectors), label, "path"))
    return pd.concat(places)


def _places(places: np.ndarray, label: str, kind: str) -> pd.DataFrame:
    names = pd.DataFrame({"initializer": label, "what": kind}, range(len(places)))
    names[["distance", "axis"]] = places
    return names


# What was run


@table("report")
def run(results: Results) -> pd.DataFrame:
    """Params, versions and the commit of the code; no time of day, place or machine, so that equal
    results of equal code have equal reports.
    """
    return described(results.params.model_dump(exclude=UNUSED, exclude_unset=True))


def described(params: Mapping[str, Any]) -> pd.DataFrame:
    """The table of a run with these params."""
    rows = [(name, str(value)) for name, value in _flat(params)]
    rows.append(("python", platform.python_version()))
    rows += [(name, version(name)) for name in _PACKAGES]
    rows += commit_of_code().items()
    return pd.DataFrame(rows, columns=["name", "value"])


def commit_of_code() -> dict[str, str]:
    """The last commit that changed ``CODE``, and its date; empty outside of git or with changes
    that are not committed. It is the same before and after the results are committed.
    """
    log = ("git", "log", "-1", "--format=%h %cs", "--abbrev=10", "--", *CODE)
    changed = ("git", "status", "--porcelain", "--", *CODE)
    with suppress(OSError, subprocess.CalledProcessError):
        if not _output(changed):
            return dict(zip(("commit", "date"), _output(log).split(), strict=False))
    return {}


def _output(command: Sequence[str]) -> str:
    return subprocess.run(command, check=True, capture_output=True, text=True).stdout


def _flat(values: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    for key, value in values.items():
        if isinstance(value, dict) and value:
            yield from _flat(value, f"{prefix}{key}.")
        else:
            yield prefix + key, value
