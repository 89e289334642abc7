"""How the joint model does with other settings, on folds (section 5.3)."""

from __future__ import annotations

from collections.abc import Mapping

import pandas as pd

from isi.params import Setting
from isi.report.results import Results
from isi.report.tables import HALVES, Table


def cross_validation(results: Results) -> Table:
    """Mean and deviation of MRR* over folds for each setting; the choice first."""
    paper = results.paper["training"]
    lines = []
    for setting in results.params.settings:
        values = setting.model_dump()
        rows = results.cross_validation
        own = rows[(rows[list(values)] == pd.Series(values)).all(axis=1)]
        means = 100 * own[list(HALVES)].mean().rename(HALVES)
        choosers = (("this run", setting == results.params.choice), ("paper", values == paper))
        lines.append(
            {name.replace("_", " "): f"{value:g}" for name, value in values.items()}
            | {"MRR*": means["MRR*"], "std": 100 * own["mrr_star"].std(ddof=1)}
            | {half: means[half] for half in list(HALVES.values())[1:]}
            | {
                "best epoch": own["epoch"].mean(),
                "choice of": ", ".join(who for who, chose in choosers if chose),
            }
        )
    return Table(
        "cross_validation",
        "Cross-validation of the joint model",
        f"MRR* (points) on the fold held out, mean and standard deviation over {results.params.cross_validation.folds} "
        "folds of unique triples (those without which an entity or relation could not be trained stay in train in "
        "every fold), one factor at a time around the choice of this run. The fold held out also tells when training "
        f"stops, as validation triples do for Θ⁰. No triple is left for testing, so more of them are "
        "trained on and filtered than in the main experiment, and values lie above its own. "
        f"The paper chose {_named(paper)}.",
        pd.DataFrame(lines),
    )


def sentence(results: Results) -> str:
    """The choice of this run, and what did best."""
    rows = results.cross_validation
    means = rows.groupby(list(Setting.model_fields), sort=False)["mrr_star"].mean().mul(100).reset_index()
    choice = results.params.choice.model_dump()
    own = means[(means[list(choice)] == pd.Series(choice)).all(axis=1)].iloc[0]
    top = means.iloc[int(means["mrr_star"].to_numpy().argmax())]
    chosen = f"The choice of this run ({_named(choice)}) has {own['mrr_star']:.1f}"
    if top["mrr_star"] == own["mrr_star"]:
        return f"{chosen} points of MRR*, and no other setting has more."
    return f"{chosen} points of MRR*, the best setting ({_named(top)}) {top['mrr_star']:.1f}."


def best(results: Results, factor: str) -> float:
    """The value of one factor that did best, the others as chosen; the choice where it did as well."""
    others = [name for name in Setting.model_fields if name != factor]
    choice = pd.Series(results.params.choice.model_dump())
    rows = results.cross_validation
    own = rows[(rows[others] == choice[others]).all(axis=1)]
    means = own.groupby(factor)["mrr_star"].mean()
    top = means.index.to_numpy()[means.to_numpy() == means.max()]
    return float(choice[factor] if choice[factor] in top else top[0])


def _named(values: Mapping[str, float] | pd.Series) -> str:
    return ", ".join(f"{name.replace('_', ' ')} {values[name]:g}" for name in Setting.model_fields)


TABLES = (cross_validation,)
