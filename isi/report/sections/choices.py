"""Choices of this run against others: indicator set sizes (Figures 2a, 2b), cross-validation,
embedding models.
"""

from collections.abc import Mapping, Sequence
from math import nan
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.figure import Figure as Canvas
from matplotlib.ticker import MaxNLocator

from isi.evaluation.query_sets import CONVERGING
from isi.models.model import MODELS
from isi.report import charts
from isi.report.charts import INK, ISI, PAPER, FigureLayout
from isi.report.data import Results
from isi.report.figures import Chart, line_over_seeds
from isi.report.section import Content, Contents
from isi.report.stats import Values, over_seeds, where
from isi.report.tables import Column, Rows
from isi.report.words import HALVES, SCOPES, Names, label

#: Indicator set sizes, by source (this run, the paper, the rule) and initializer.
Chosen = Mapping[str, Mapping[str, int]]
#: A value for each factor that cross-validation varies.
Setting = Values
#: Dots of the chosen sizes in figures, by source: sizes, from the lowest up.
_DOTS: dict[str, list[tuple[float, str]]] = {
    "paper": [(17, ISI), (13, PAPER)],
    "this run": [(9, ISI)],
    "picked by the rule": [(11, INK), (7, PAPER)],
}
#: The same in the key of figures.
_KEY = [
    ("this run", 8, ISI, ISI),
    ("paper", 12, ISI, PAPER),
    ("picked by the rule", 8, INK, PAPER),
]
#: The paper's rule: average epochs over NEIGHBOURS neighbouring sizes; grow while the average falls
#: by at least EPOCHS and MRR*, in [0, 1], is at most LOSS below the best.
NEIGHBOURS, EPOCHS, LOSS = 3, 1.0, 0.01


def indicators(results: Results) -> Contents:
    """Sensitivity to the indicator set size (section 5.3): Figures 2a and 2b, and their numbers."""
    for experiment, sweep in results.analysis("sweep"):
        models, runs = list(results.params.sweep.initializers), where(sweep, epoch=0)
        epochs = experiment.converged(sweep, ["model", "k"])
        means = means_of(runs, epochs, models)
        chosen = chosen_sizes(means, results.params.initializers, results.paper["indicators"])
        of_points = runs.assign(value=100 * runs["mrr_star"])
        of_epochs = epochs.assign(value=epochs["epochs"])
        now = _by_size("MRR* (points)", of_points, ("all", "novel"), models, chosen)
        later = _by_size("epochs to convergence", of_epochs, CONVERGING, models, chosen)
        frame = means.rename(index=label, level="model").reset_index()
        yield Content(
            {"chosen": chosen, "models": models},
            {
                "indicator_sizes": indicator_sizes(means, chosen),
                "sensitivity": frame.rename(columns={"model": "initializer", "k": "indicators"}),
            },
            {"figure2a_immediate_sensitivity": now, "figure2b_convergence_sensitivity": later},
        )


def means_of(immediate: pd.DataFrame, epochs: pd.DataFrame, models: Names) -> pd.DataFrame:
    """Means over seeds: a row for each model and k, a ``Column`` for each measure and scope;
    MRR* in points.
    """
    by = ["model", "k", "scope"]
    groups = epochs.groupby(by)
    measures = {
        "MRR*": 100 * immediate.groupby(by)["mrr_star"].mean(),
        "epochs": groups["epochs"].mean(),
        "unconverged %": 100 * (1 - groups["converged"].mean()),
    }
    shown = [("MRR*", "all"), ("MRR*", "novel")]
    shown += [(name, scope) for scope in CONVERGING for name in ("epochs", "unconverged %")]
    by_scope = {name: means.unstack("scope") for name, means in measures.items()}
    columns = {Column(name, scope): by_scope[name].get(scope) for name, scope in shown}
    frame = pd.DataFrame(columns, index=by_scope["MRR*"].index, dtype=float)
    return frame.loc[[model for model in models if model in frame.index]]


def chosen_sizes(
    means: pd.DataFrame, options: Mapping[str, Any], paper: Mapping[str, int]
) -> dict[str, dict[str, int]]:
    """Indicator set sizes of this run's options, of the paper and of the paper's rule,
    by initializer.
    """
    picked = picked_sizes(means)
    return {
        "this run": {
            model: int(options[model]["k"]) for model in picked if "k" in options.get(model, {})
        },
        "paper": {model: paper[model] for model in picked if model in paper},
        "picked by the rule": picked,
    }


def picked_sizes(means: pd.DataFrame) -> dict[str, int]:
    """The size that the paper's rule picks for each initializer from MRR* and
    epochs about novel entities.
    """
    picked = {}
    for model in means.index.unique("model"):
        of_model = means.loc[model]
        mrr_star = of_model[Column("MRR*", "novel")] / 100
        epochs = of_model[Column("epochs", "novel_heldout")]
        picked[model] = select_size(of_model.index.tolist(), mrr_star.tolist(), epochs.tolist())
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


def indicator_sizes(means: pd.DataFrame, chosen: Chosen) -> Rows:
    """The indicator set size that the paper's rule picks,
    beside those of this run and of the paper.
    """
    mrr_star, epochs = means[Column("MRR*", "novel")], means[Column("epochs", "novel_heldout")]
    return [
        {
            "initializer": label(model),
            **{who: sizes.get(model) for who, sizes in chosen.items()},
            Column("MRR*", "at the picked number"): mrr_star[model, size],
            Column("epochs", "at the picked number"): epochs[model, size],
            "best MRR*": mrr_star[model].max(),
            "best at": mrr_star[model].idxmax() if mrr_star[model].notna().any() else None,
        }
        for model, size in chosen["picked by the rule"].items()
    ]


def _by_size(
    ylabel: str, rows: pd.DataFrame, scopes: Names, models: Names, chosen: Chosen
) -> Chart:
    """Mean and interval of ``value`` by k, with the chosen sizes; a panel for each scope."""
    height = 300

    def draw(layout: FigureLayout) -> tuple[Canvas, str]:
        canvas, axes = charts.panels(layout, len(scopes), height)
        for panel, scope in zip(axes, scopes, strict=True):
            ends = []
            for model in models:
                of_model = where(rows, model=model, scope=scope)
                if not len(of_model):
                    continue
                sizes, mean, low, high = line_over_seeds(of_model, "k", "value", 1)
                charts.shaded(panel, sizes, low, high, ISI)
                charts.line(panel, sizes, mean, model, models, clip_on=False)
                ends.append((mean[-1], label(model), ISI))
                for who, marks in _DOTS.items():
                    k = chosen[who].get(model, nan)
                    height_there = np.interp(k, sizes, mean, left=nan, right=nan)
                    for size, color in marks if height_there == height_there else []:
                        place = np.array([[k, height_there]])
                        charts.dots(panel, place, size, color, zorder=4, clip_on=False)
            if rows["value"].min() >= 0 and ylabel.startswith("epochs"):
                panel.set_ylim(bottom=0)
            charts.framed(panel, SCOPES[scope], "indicators k", ylabel)
            if len(rows):
                panel.set_xlim(0, rows["k"].max())
            panel.xaxis.set_major_locator(MaxNLocator(integer=True))
            charts.names(panel, ends, height - 90, layout.width / layout.columns - 80)
        charts.key(canvas, _KEY)
        return canvas, charts.in_words(axes)

    return charts.drawn(draw)


def cross_validation(results: Results) -> Contents:
    """Cross-validation of the joint model with other settings (section 5.3)."""
    for _, rows in results.analysis("cross_validation"):
        settings = [setting.model_dump() for setting in results.params.settings]
        choice, paper = settings[0], results.paper["training"]
        if _of_setting(rows, choice).empty:
            yield Content({"points": None})
            return
        means = 100 * rows.groupby(list(choice), sort=False)["mrr_star"].mean()
        top = int(means.to_numpy().argmax())
        best = dict(zip(choice, means.index[top], strict=True))
        numbers = {
            "points": (means[tuple(choice.values())], means.iloc[top]),
            "choice": choice,
            "best": best,
            "within": _beside(rows, choice, best)[1],
        }
        yield Content(numbers, {"cross_validation": cross_validation_table(rows, settings, paper)})


def cross_validation_table(rows: pd.DataFrame, settings: Sequence[Setting], paper: Setting) -> Rows:
    """A row for each setting, this run's first:
    mean and deviation of MRR* over folds, and whose choice it is.
    """
    lines, choice = Rows(), settings[0]
    for setting in settings:
        folds, (lead, within) = _of_setting(rows, setting), _beside(rows, choice, setting)
        measures = folds[list(HALVES)].mean().rename(HALVES)
        who = {"this run": choice, "paper": paper}
        lines.append(
            {name.replace("_", " "): f"{value:g}" for name, value in setting.items()}
            | {
                "MRR*": 100 * measures["MRR*"],
                "std": 100 * folds["mrr_star"].std(),
                "entity half": 100 * measures["entity half"],
                "relation half": 100 * measures["relation half"],
                "best epoch": folds["epoch"].mean(),
                Column("from the choice", form="{:+.1f}".format): lead,
                "beyond the folds' deviation": "no" if within else "yes",
                "choice of": ", ".join(name for name, best in who.items() if setting == best),
            }
        )
    lines[0]["beyond the folds' deviation"] = ""
    return lines


def _beside(rows: pd.DataFrame, choice: Setting, other: Setting) -> tuple[float, bool]:
    """Mean MRR* of setting ``other`` minus that of ``choice``, in points; whether this is less
    than the larger of their standard deviations over folds.
    """
    first, second = (_of_setting(rows, setting)["mrr_star"] for setting in (choice, other))
    lead = float(100 * (second.mean() - first.mean()))
    return lead, bool(abs(lead) < 100 * max(first.std(), second.std()))


def _of_setting(rows: pd.DataFrame, setting: Setting) -> pd.DataFrame:
    return rows[(rows[list(setting)] == pd.Series(setting)).all(axis=1)]


def best(rows: pd.DataFrame, choice: Setting, factor: str) -> tuple[float, str]:
    """Best value of ``factor``, others as in ``choice`` (which wins ties); a note if it differs;
    NaN without folds.
    """
    others = _of_setting(rows, {name: value for name, value in choice.items() if name != factor})
    means = others.groupby(factor)["mrr_star"].mean().dropna()
    top = list(means[means == means.max()].index)
    if not top:
        return nan, ""
    if choice[factor] in top:
        return float(choice[factor]), ""
    lead, within = _beside(rows, choice, {**choice, factor: top[0]})
    less = ", less than the folds deviate" if within else ""
    return float(top[0]), f"{lead:+.1f} points from the choice of this run{less}"


def embedding_models(results: Results) -> Contents:
    """The joint model with each embedding model,
    whose training options were chosen on validation triples.
    """
    for experiment, rows in results.analysis("compare_models"):
        settings = results.params.compare_models
        options = {
            name: model.model_dump() | results.params.models[name]
            for name, model in settings.models.items()
        }
        means = 100 * rows.groupby("model")["mrr_star"].mean()
        numbers = {
            "title": experiment.title,
            "main": class_name(results.params.embedding.model),
            "means": means.sort_values(ascending=False, kind="stable").rename(class_name),
        }
        if len(rows):
            yield Content(numbers, {"embedding_models": embedding_table(rows, options)})


def class_name(model: str) -> str:
    """The display name of an embedding model."""
    return MODELS.get(model, f"models.{model}").__name__


def embedding_table(rows: pd.DataFrame, options: Mapping[str, Mapping[str, Any]]) -> Rows:
    """A row for each embedding model: measures, mean over seeds,
    and the options that were chosen for it.
    """
    columns = {**HALVES, "mrr": "MRR", "valid_mrr_star": "validation MRR*"}
    means, epochs = over_seeds(rows, ["model"], columns), rows.groupby("model")["epochs"].mean()
    return [
        {"embedding": class_name(name), **means.loc[name], "epochs": epochs[name]}
        | {option.replace("_", " "): _written(value) for option, value in values.items()}
        for name, values in options.items()
        if name in means.index
    ]


def _written(value: object) -> str:
    """The value of an option as text."""
    if isinstance(value, bool):
        return "yes" if value else "no"
    return f"{value:g}" if isinstance(value, float) else str(value)
