"""The graphs, the choices of this run against others, and what was run and left out."""

import platform
from collections.abc import Iterator, Mapping, Sequence
from functools import cache
from importlib.metadata import version
from math import nan
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from safetensors.numpy import load_file

from isi.analyses.projection import Projection
from isi.evaluation.query_sets import CONVERGING
from isi.report.tables.data import Results, read
from isi.report.tables.estimates import HALVES, Line, over_seeds, where
from isi.report.tables.forms import ANY_SIZE
from isi.report.tables.registry import table
from isi.report.tables.results import in_order

#: The paper's rule: average epochs over NEIGHBOURS neighbouring sizes; grow while the average falls
#: by at least EPOCHS and MRR*, in [0, 1], is at most LOSS below the best.
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
#: Sections of params that the table of the run omits.
UNUSED = {"compute", "recorder", "plots", "finetune_only", "final_model"}
#: A value for each factor that cross-validation varies.
Setting = Mapping[str, float]


# The graphs


@table("report")
def graph_totals(results: Results) -> pd.DataFrame:
    """Counts of the first graph beside the paper's."""
    first, paper = results.standalone[0], results.paper["graph"]
    entities, triples = first.entities, first.triples
    kinds = in_order(entities["kind"].unique(), results.vocabulary["kinds"])
    ours = {
        "observations": int(triples["count"].sum()),
        "unique_triples": len(triples),
        "entities": len(entities),
        **{kind: int((entities["kind"] == kind).sum()) for kind in kinds},
    }
    titles = {name: name.replace("_", " ") for name in ours} | {
        kind: f"{kind} entities" for kind in kinds
    }
    rows = [(titles[name], number, paper.get(name)) for name, number in ours.items()]
    return pd.DataFrame(rows, columns=["", "this run", "paper"])


@table("report")
def table1_graph_statistics(results: Results) -> pd.DataFrame | None:
    """Table 1: median counts per environment by room type, beside the paper's."""
    source = results.standalone[0].settings.graph.source
    observations = read(f"data/observations/{source}.parquet")
    if not observations["scene"].notna().any():
        return None
    return table1(
        observations, results.paper["graph"]["median_per_environment"], results.vocabulary
    )


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


@cache
def indicator_means(results: Results) -> pd.DataFrame | None:
    """The sweep of indicator set sizes: means over seeds by model and k, a column for each scope
    and measure; MRR* in points with its interval.
    """
    first, models = results.standalone[0], results.params.sweep.initializers
    sweep = first.swept("sweep", "indicator_sweep", list(models))
    if sweep is None:
        return None
    by = ["scope", "model", "k"]
    epochs = first.converged(sweep, ["model", "k"])
    now = over_seeds(where(sweep, epoch=0), by, {"mrr_star": "MRR*"})
    later = over_seeds(epochs, by, {"epochs": "epochs"}, scale=1)
    later["unconverged %"] = 100 * (1 - epochs.groupby(by)["converged"].mean())
    parts = [now.loc[scope].add_prefix(f"{scope}: ") for scope in ("all", "novel")]
    parts += [
        later.loc[scope].add_prefix(f"{scope}: ")
        for scope in CONVERGING
        if scope in later.index.unique("scope")
    ]
    means = pd.concat(parts, axis=1)
    return means.loc[[model for model in models if model in means.index.unique("model")]]


@table("report")
def sensitivity(results: Results) -> pd.DataFrame | None:
    """Sensitivity to the indicator set size (Figures 2a and 2b)."""
    means = indicator_means(results)
    if means is None:
        return None
    named = results.models.labelled(means.reset_index(), "model")
    return named.rename(columns={"model": "initializer", "k": "indicators"})


@table("report")
def indicator_sizes(results: Results) -> pd.DataFrame | None:
    """The indicator set size that the paper's rule picks, beside those of this run and of the
    paper.
    """
    means = indicator_means(results)
    if means is None:
        return None
    rows, options = list[Line](), results.params.initializers
    for model, size in picked_sizes(means).items():
        of_model = means.loc[model]
        mrr_star = of_model["novel: MRR*"]
        rows.append(
            {
                "initializer": results.models.labels[model],
                "this run": options.get(model, {}).get("k", nan),
                "paper": results.paper["indicators"].get(model, nan),
                "picked by the rule": size,
                "at the picked number: MRR*": mrr_star[size],
                "at the picked number: epochs": of_model.loc[size, "novel_heldout: epochs"],
                "best MRR*": mrr_star.max(),
                "best at": mrr_star.idxmax(),
            }
        )
    return pd.DataFrame(rows)


def picked_sizes(means: pd.DataFrame) -> dict[str, int]:
    """The size that the paper's rule picks for each initializer from MRR* and epochs about novel
    entities.
    """
    picked = dict[str, int]()
    for model in means.index.unique("model"):
        of_model = means.loc[model]
        mrr_star = (of_model["novel: MRR*"] / 100).tolist()
        epochs = of_model["novel_heldout: epochs"].tolist()
        picked[model] = select_size(of_model.index.tolist(), mrr_star, epochs)
    return picked


def select_size(sizes: Sequence[int], mrr_star: Sequence[float], epochs: Sequence[float]) -> int:
    """The indicator set size that the paper's rule picks (section 5.3).

    The paper "increased the indicator set size while the average number of epochs for three
    neighboring sizes decreased by 1 epoch or the MRR* went 1% point below the best performance". We
    grow while the average falls, and stop before MRR* is too low. Neighbours are those in the list:
    the average is first compared between the second and the third size, and the last size is never
    picked. The best performance is the best among smaller sizes. The first size is picked if MRR*
    of the second is too low, or if there are fewer than three sizes.

    Sizes ascend; ``mrr_star`` is immediate MRR* in [0, 1], ``epochs`` the mean epochs to
    convergence, by size.
    """
    means = [sum(epochs[place - 1 : place + 2]) / NEIGHBOURS for place in range(1, len(sizes) - 1)]
    picked = 0
    for place in range(1, len(sizes) - 1):
        # NaN counts as no gain
        no_gain = place > 1 and not means[place - 2] - means[place - 1] >= EPOCHS
        if no_gain or mrr_star[place] < max(mrr_star[:place]) - LOSS:
            break
        picked = place
    return sizes[picked]


@table("report")
def cross_validation(results: Results) -> pd.DataFrame | None:
    """A row for each setting, this run's first: mean and deviation of MRR* over folds, and whose
    choice it is.
    """
    rows = results.standalone[0].analysis("cross_validation")
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


def by_setting(rows: pd.DataFrame, choice: Setting) -> pd.DataFrame | None:
    """Means over folds, and the deviation of MRR* (points), by setting; MRR* ``from the choice``,
    and whether this is ``within`` the larger of the two deviations; None without the choice.
    """
    groups = rows.groupby(list(choice))
    measures = 100 * groups[list(HALVES)].mean().rename(columns=HALVES)
    measures.insert(1, "std", 100 * groups["mrr_star"].std())
    measures["best epoch"] = groups["epoch"].mean()
    place = tuple(choice.values())
    if place not in measures.index:
        return None
    lead = measures["MRR*"] - measures["MRR*"][place]
    spread = measures["std"].clip(lower=measures["std"][place])
    return measures.assign(**{"from the choice": lead, "within": lead.abs() < spread})


# One insertion (Figure 1)


@table("report")
def figure1_trajectory(results: Results) -> pd.DataFrame | None:
    """The places of Figure 1: the path of one novel entity through fine-tuning."""
    first = results.standalone[0]
    file = Path(f"data/analyses/trajectory/{first.name}.safetensors")
    if first.name not in results.params.trajectory.experiments or not file.exists():
        return None
    traces = load_file(file)
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
        path = traces[f"{model}.path"].astype(np.float64)
        places.append(_places(plane.places(path), label, "path"))
    return pd.concat(places)


def _places(places: np.ndarray, label: str, kind: str) -> pd.DataFrame:
    names = pd.DataFrame({"initializer": label, "what": kind}, range(len(places)))
    names[["distance", "axis"]] = places
    return names


# What was run


@table("report")
def run(results: Results) -> pd.DataFrame:
    """Params and versions; no time, place, machine or hash of the code, so that equal results have
    equal reports.
    """
    values = results.params.model_dump(exclude=UNUSED, exclude_unset=True)
    rows = [(name, str(value)) for name, value in _flat(values)]
    rows.append(("python", platform.python_version()))
    rows += [(name, version(name)) for name in _PACKAGES]
    return pd.DataFrame(rows, columns=["name", "value"])


def _flat(values: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    for key, value in values.items():
        if isinstance(value, dict) and value:
            yield from _flat(value, f"{prefix}{key}.")
        else:
            yield prefix + key, value
