"""How the joint model does with other settings, on folds (section 5.3)."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from math import isnan, nan
from typing import Any

import pandas as pd

from isi.report.results import Results
from isi.report.section import Content, Section, Table
from isi.report.statistics import HALVES

#: A value for each factor that is varied.
Setting = Mapping[str, float]


def contents(results: Results) -> Iterator[Content]:
    """The choice of this run and the best in words, and every setting."""
    if results.cross_validation is None:
        return
    rows = results.cross_validation.found
    settings, folds = settings_of(results), results.params.cross_validation.folds
    if of_setting(rows, settings[0]).empty:
        yield "There are no folds of the choice of this run, with which others could be compared."
        return
    yield f"The joint model with other settings, on {folds} folds of unique triples. {sentence(rows, settings[0])}"
    yield cross_validation(rows, settings, results.paper["training"], folds)


def settings_of(results: Results) -> list[Setting]:
    """What was compared, the choice of this run first."""
    return [setting.model_dump() for setting in results.params.settings]


def cross_validation(rows: pd.DataFrame, settings: Sequence[Setting], stated: Setting, folds: int) -> Table:
    """Mean and deviation of MRR* over folds for each setting.

    Args:
        rows: ``tables.CROSS_VALIDATION``.
        settings: the choice of this run first.
        stated: the paper's choice.
    """
    lines = []
    for setting in settings:
        own = of_setting(rows, setting)
        means = 100 * own[list(HALVES)].mean().rename(HALVES)
        choosers = (("this run", setting == settings[0]), ("paper", setting == stated))
        lines.append(
            {name.replace("_", " "): f"{value:g}" for name, value in setting.items()}
            | {"MRR*": means["MRR*"], "std": 100 * own["mrr_star"].std(ddof=1)}
            | {half: means[half] for half in list(HALVES.values())[1:]}
            | {
                "best epoch": own["epoch"].mean(),
                "from the choice": lead(rows, settings[0], setting),
                "told apart": "" if setting == settings[0] else "no" if within(rows, settings[0], setting) else "yes",
                "choice of": ", ".join(who for who, chose in choosers if chose),
            }
        )
    return Table(
        "cross_validation",
        "Cross-validation of the joint model",
        f"MRR* (points) on the fold held out, mean and standard deviation over {folds} "
        "folds of unique triples (those without which an entity or relation could not be trained stay in train in "
        "every fold), one factor at a time around the choice of this run. Not told apart: the mean is less far from "
        "that of the choice than the folds of either deviate. The fold held out also tells when training "
        f"stops, as validation triples do for Θ⁰. No triple is left for testing, so more of them are "
        "trained on and filtered than in the main experiment, and values lie above its own. "
        f"The paper chose {_named(stated)}.",
        pd.DataFrame(lines),
        {"from the choice": "{:+.1f}".format},
    )


def lead(rows: pd.DataFrame, choice: Setting, other: Setting) -> float:
    """How far the mean of a setting is above that of the choice, in points."""
    first, second = (of_setting(rows, setting)["mrr_star"].mean() for setting in (other, choice))
    return float(100 * (first - second))


def within(rows: pd.DataFrame, choice: Setting, other: Setting) -> bool:
    """Whether that is less than the folds of either deviate (standard deviation over folds)."""
    spread = max(of_setting(rows, setting)["mrr_star"].std(ddof=1) for setting in (choice, other))
    return bool(abs(lead(rows, choice, other)) < 100 * spread)


def of_setting(rows: pd.DataFrame, setting: Setting) -> pd.DataFrame:
    """The folds of one setting."""
    return rows[(rows[list(setting)] == pd.Series(setting)).all(axis=1)]


def sentence(rows: pd.DataFrame, choice: Setting) -> str:
    """The choice of this run, and what did best."""
    means = rows.groupby(list(choice), sort=False)["mrr_star"].mean().mul(100).reset_index()
    own = of_setting(means, choice).iloc[0]
    top = means.iloc[int(means["mrr_star"].to_numpy().argmax())]
    chosen = f"The choice of this run ({_named(choice)}) has {own['mrr_star']:.1f}"
    if top["mrr_star"] == own["mrr_star"]:
        return f"{chosen} points of MRR*, and no other setting has more."
    ahead = _named({name: top[name] for name in choice})
    text = f"{chosen} points of MRR*, the best setting ({ahead}) {top['mrr_star']:.1f}"
    if within(rows, choice, {name: top[name] for name in choice}):
        text += ", which is less than the folds deviate"
    return f"{text}."


def best(rows: pd.DataFrame, choice: Setting, factor: str) -> float:
    """The value of one factor that did best, the others as chosen; the choice where it did as well; NaN of no folds."""
    own = of_setting(rows, {name: value for name, value in choice.items() if name != factor})
    if own.empty:
        return nan
    means = own.groupby(factor)["mrr_star"].mean()
    top = means.index.to_numpy()[means.to_numpy() == means.max()]
    return float(choice[factor] if choice[factor] in top else top[0])


def note(rows: pd.DataFrame, choice: Setting, factor: str) -> str:
    """What there is to say of the best value of one factor: whether folds tell it from the choice."""
    value = best(rows, choice, factor)
    if isnan(value) or value == choice[factor]:
        return ""
    found = lead(rows, choice, {**choice, factor: value})
    less = within(rows, choice, {**choice, factor: value})
    return f"{found:+.1f} points from the choice of this run{', less than the folds deviate' if less else ''}"


def _named(values: Mapping[str, Any]) -> str:
    return ", ".join(f"{name.replace('_', ' ')} {value:g}" for name, value in values.items())


SECTION = Section("cross-validation", "Cross-validation", contents)
