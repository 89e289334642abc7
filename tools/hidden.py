"""Write docs/benchmarks/hidden*.* from the results of the stage `insert_hidden`.

``hidden.csv`` compares the default of ``isi.pykeen.insert`` with the best initializer and with
training from scratch, and says which bars it misses; ``hidden_summary.md`` and
``hidden_counts.csv`` count these misses, and ``hidden_methods.csv`` has every method.
"""

import json
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import pandas as pd
from pykeen.models import model_resolver
from scipy.stats import t, ttest_1samp

from isi.extras.hidden_entities import HIDDEN_ENTITIES, Hidden, seconds_path, study_of
from isi.params import load, load_beyond
from isi.process import errors_in_one_line
from isi.report.tables.estimates import holm
from tools.docs import BENCHMARKS, write_table

ALL = "all"
#: Values of ``asked`` (known or hidden answers), and the first words of the titles of their
#: columns.
QUERIES = {"known": "known ends", "hidden": "hidden ones"}
#: Names of losses in the tables, by PyKEEN's names.
LOSSES = {
    "softplus": "logistic",
    "crossentropy": "cross-entropy",
    "marginranking": "margin",
    "nssa": "self-adversarial",
}
#: Bars of the default, in MRR. Largest loss of earlier triples with all facts, and with fewer.
MOST_LOST, MOST_LOST_OF_FEW = 0.02, 0.03
#: How far known ends may be below the best initializer.
BELOW_BEST = 0.02
#: Largest ratio of the estimated and the real loss, either way, unless both are small.
RATIO, SMALL = 1.5, 0.005
#: Largest p, by Holm's correction over studies, of a difference that is called significant.
LEVEL = 0.05
#: A sentence of the summary for each bar.
SENTENCES = {
    "loss": (
        f"The loss of earlier triples exceeds its bar ({MOST_LOST:g} with all facts, else "
        f"{MOST_LOST_OF_FEW:g})"
    ),
    "estimate": (
        f"The estimated loss is off by more than a factor of {RATIO:g} (where one of both exceeds "
        f"{SMALL:g})"
    ),
    "known ends": (
        f"The MRR of known ends is more than {BELOW_BEST:g} below the best named initializer's"
    ),
    "retraining": "The MRR of known ends is below that after training from scratch",
}


def label(method: str, settings: Hidden) -> str:
    """Title of a method."""
    insert = "isi.pykeen.insert"
    return {
        "nothing": "nothing inserted",
        "insert": f"{insert}, its default",
        "own": "PyKEEN's own initialization",
        "insert_new_rows": f"{insert} and {settings.epochs} epochs of the new rows",
        "own_new_rows": f"PyKEEN's own and {settings.epochs} epochs of the new rows",
        "own_all_rows": f"PyKEEN's own and {settings.epochs} epochs of all rows",
        "retrained": "retrained from scratch",
    }.get(method, f"{insert}: {method}")


def numbered(facts: float) -> str:
    """A maximum number of insert triples as text; NaN: all."""
    return ALL if pd.isna(facts) else f"{facts:.0f}"


def by_seed(results: pd.DataFrame) -> pd.DataFrame:
    """MRR by seed: rows (method, seed), columns (maximum number of insert triples, ``asked``)."""
    numbers = results["told"].map(numbered)
    rows = results.assign(told=numbers).astype({"method": str, "asked": str})
    table: pd.DataFrame = rows.pivot(
        index=["method", "seed"], columns=["told", "asked"], values="mrr"
    )
    return table


def interval(values: pd.Series) -> tuple[float, float]:
    """Mean over seeds, and the half width of its 95 % interval (Student's t);
    NaN with a single seed.
    """
    return values.mean(), t.ppf(0.975, len(values) - 1) * values.sem()


def with_interval(values: pd.Series) -> str:
    mean, half = interval(values)
    return f"{mean:.3f}" if np.isnan(half) else f"{mean:.3f} ± {half:.3f}"


def against_retraining(studies: Mapping[str, pd.DataFrame]) -> pd.DataFrame:
    """By study: the MRR of known ends with all facts with the default, minus that after training
    from scratch (``difference``, a mean over seeds); p of the t-test paired by seed, and its
    correction by Holm over all studies that have one. Studies with one seed have none.
    """
    rows = {}
    for name, mrr in studies.items():
        if "retrained" not in mrr.index:
            continue
        pairs = mrr.loc["insert"][ALL, "known"] - mrr.loc["retrained"][ALL, "known"]
        p = float(ttest_1samp(pairs, 0).pvalue) if len(pairs) > 1 else np.nan
        rows[name] = {"difference": pairs.mean(), "p": p}
    table = pd.DataFrame.from_dict(rows, "index", columns=["difference", "p"], dtype=float)
    table = table.dropna()
    return table.assign(corrected=holm(table["p"].to_numpy()))


def number_or_blank(value: float) -> str:
    return "" if np.isnan(value) else f"{value:.3f}"


def loss(mrr: pd.DataFrame, method: str, number: str) -> pd.Series:
    """By seed: the MRR of earlier triples before the insertion, minus that after it."""
    return mrr.loc["nothing"][ALL, "earlier"] - mrr.loc[method][number, "earlier"]


def estimated(results: pd.DataFrame, number: str) -> float:
    """Mean over seeds of the loss that the selection of the default expects; NaN if none."""
    numbers = results["told"].map(numbered)
    return float(results.loc[numbers == number, "estimated_loss"].mean())


def model_of(settings: Hidden) -> str:
    """The model and the loss that it was trained with."""
    training = settings.training
    model = model_resolver.lookup(training.model).__name__
    return f"{model}, {LOSSES.get(training.loss, training.loss)}"


@dataclass(frozen=True)
class Means:
    """Means over seeds for a number of facts; NaN: not measured."""

    facts: str
    known_ends: float  #: MRR with the default
    best: float  #: the highest MRR of known ends with a named initializer
    best_named: str  #: that initializer
    best_loss: float  #: what the MRR of earlier triples loses with it
    retrained: float  #: MRR of known ends after training from scratch
    loss: float  #: of the default
    estimated: float  #: the loss that the selection of the default expects


def means_of(mrr: pd.DataFrame, results: pd.DataFrame, settings: Hidden) -> list[Means]:
    """For each number of facts."""
    means = []
    for number in (str(number or ALL) for number in settings.max_insert_triples):
        ends = mrr[number, "known"].groupby("method").mean()
        best = str(ends[settings.initializers].idxmax())
        means.append(
            Means(
                number,
                known_ends=ends["insert"],
                best=ends[best],
                best_named=best,
                best_loss=loss(mrr, best, number).mean(),
                retrained=ends.get("retrained", np.nan),
                loss=loss(mrr, "insert", number).mean(),
                estimated=estimated(results, number),
            )
        )
    return means


def most_lost(facts: str) -> float:
    """The bar of what earlier triples lose."""
    return MOST_LOST if facts == ALL else MOST_LOST_OF_FEW


def differences(means: Means) -> dict[str, float]:
    """By bar: the loss above its bar; the estimated minus the real loss; the MRR of known ends
    minus that of the best initializer, and minus that after training from scratch.
    """
    by_bar = {
        "loss": means.loss - most_lost(means.facts),
        "estimate": means.estimated - means.loss,
        "known ends": means.known_ends - means.best,
        "retraining": means.known_ends - means.retrained,
    }
    return {bar: difference for bar, difference in by_bar.items() if not np.isnan(difference)}


def misses(means: Means) -> dict[str, float]:
    """The ``differences`` of the bars that the default misses."""
    low, high = sorted([means.estimated, means.loss])
    is_missed = {
        "loss": means.loss > most_lost(means.facts),
        "estimate": high > SMALL and high > RATIO * low,
        "known ends": means.best - means.known_ends > BELOW_BEST,
        "retraining": means.known_ends < means.retrained,
    }
    return {bar: value for bar, value in differences(means).items() if is_missed[bar]}


def compared(mrr: pd.DataFrame, means: list[Means]) -> pd.DataFrame:
    """A row for each number of insert triples:
    the default, the best initializer and training from scratch.
    """
    rows = []
    for row in means:
        number, with_all = row.facts, row.facts == ALL and "retrained" in mrr.index
        known_ends = mrr.loc["insert"][number, "known"]
        minus_retrained, again = "", np.nan
        if with_all:
            minus_retrained = with_interval(known_ends - mrr.loc["retrained"][number, "known"])
            again = loss(mrr, "retrained", number).mean()
        rows.append(
            {
                "facts": number,
                "known ends: default": with_interval(known_ends),
                "best named": f"{row.best:.3f} ({row.best_named})",
                "retrained": number_or_blank(row.retrained),
                "default minus retrained": minus_retrained,
                "hidden ones: default": with_interval(mrr.loc["insert"][number, "hidden"]),
                "earlier": f"{mrr.loc['nothing'][ALL, 'earlier'].mean():.3f}",
                "loss: default": with_interval(loss(mrr, "insert", number)),
                "loss: estimated": number_or_blank(row.estimated),
                "best named's": f"{loss(mrr, row.best_named, number).mean():.3f}",
                "retraining's": number_or_blank(again),
                "misses": "; ".join(f"{bar} {by:+.3f}" for bar, by in misses(row).items()),
            }
        )
    return pd.DataFrame(rows)


def summary(studies: Mapping[str, pd.DataFrame], means: Mapping[str, list[Means]]) -> str:
    """Sentences on the default; ``by_seed`` and ``means_of`` of each study by name."""
    counted = counts(studies, means)["rows"]
    tested = len(against_retraining(studies))
    rows = sum(map(len, means.values()))
    sentences = [
        "With all facts, the MRR of known ends is significantly higher with the default than "
        f"after training from scratch in {counted[HIGHER]} of {tested} studies, and significantly "
        f"lower in {counted[LOWER]} (t-tests paired by seed; p below {LEVEL:g} after Holm's "
        f"correction over the {tested} studies).",
        f"In {counted[BOTH]} of {rows} rows, the default is within {BELOW_BEST:g} of the best "
        "named initializer and within the bar of the loss.",
    ]
    for bar, words in SENTENCES.items():
        number, missed = 0, []
        for name, rows in means.items():
            for row in rows:
                number += bar in differences(row)
                if bar in misses(row):
                    missed.append((abs(misses(row)[bar]), f"{name}, facts: {row.facts}"))
        largest = max(missed, default=None)
        end = "" if largest is None else f", at most by {largest[0]:.3f} ({largest[1]})"
        sentences.append(f"{words} in {len(missed)} of {number} rows{end}.")
        if bar == "known ends":
            sentences.append(
                f"In {harmful(means)} of these, that initializer exceeds the bar of the loss."
            )
    return " ".join(sentences)


#: Rows of ``counts``.
NEAR, SAFE, BOTH = "near the best named", "within the bar of the loss", "both"
HIGHER, LOWER = "above retraining", "below retraining"


def counts(studies: Mapping[str, pd.DataFrame], means: Mapping[str, list[Means]]) -> pd.DataFrame:
    """In how many ``rows`` ``of`` all the default is at most ``BELOW_BEST`` below the best named
    initializer, at most the bar above the loss, or both; and in how many studies it is
    significantly above or below training from scratch. ``studies``: ``by_seed`` of each.
    """
    missed = [set(misses(row)) for rows in means.values() for row in rows]
    tested = against_retraining(studies)
    significant = tested.loc[tested["corrected"] < LEVEL, "difference"]
    table = {
        NEAR: (sum("known ends" not in bars for bars in missed), len(missed)),
        SAFE: (sum("loss" not in bars for bars in missed), len(missed)),
        BOTH: (sum(not {"known ends", "loss"} & bars for bars in missed), len(missed)),
        HIGHER: (int((significant > 0).sum()), len(tested)),
        LOWER: (int((significant < 0).sum()), len(tested)),
    }
    return pd.DataFrame.from_dict(table, "index", columns=["rows", "of"])


def harmful(means: Mapping[str, list[Means]]) -> int:
    """In how many rows the best initializer of known ends has a bar's more MRR than the default,
    but a loss above its bar.
    """
    rows = [row for rows in means.values() for row in rows]
    return sum("known ends" in misses(row) and row.best_loss > most_lost(row.facts) for row in rows)


def every_method(
    mrr: pd.DataFrame, results: pd.DataFrame, seconds: pd.DataFrame, settings: Hidden
) -> pd.DataFrame:
    """MRR and Hits@10 as text, and CPU seconds with all insert triples, by method."""
    mean = mrr.groupby("method").mean().loc[results["method"].astype(str).unique()]
    hits = results[results["told"].isna() & (results["asked"] == "known")].astype({"method": str})
    columns = {
        f"{title}, {number or ALL}": mean[str(number or ALL), queries]
        for queries, title in QUERIES.items()
        for number in settings.max_insert_triples
    }
    columns |= {
        "Hits@10": hits.groupby("method")["hits_at_10"].mean(),
        "earlier": mean[ALL, "earlier"],
    }
    took = seconds[seconds["told"].isna()].set_index("method")["seconds"].reindex(mean.index)
    table = pd.DataFrame(columns, mean.index).map(number_or_blank)
    table.insert(0, "method", [label(method, settings) for method in mean.index])
    return table.assign(
        s=took.map(
            lambda value: "" if pd.isna(value) else f"{value:{'.3f' if value < 1 else '.1f'}}"
        )
    ).reset_index(drop=True)


def headed(table: pd.DataFrame, settings: Hidden, **first: str) -> pd.DataFrame:
    """The table behind columns of the embedding model, the graph and others."""
    columns = {"model": model_of(settings), "graph": settings.title, **first}
    return table.assign(**columns)[[*columns, *table.columns]]


def main() -> None:
    comparison, methods, studies, means = [], [], {}, {}
    entries = load_beyond(load()).hidden
    for study in entries:
        if not HIDDEN_ENTITIES.path(study=study).exists():
            continue
        settings = study_of(entries, study)
        results = HIDDEN_ENTITIES.read(study=study)
        seconds = pd.DataFrame(json.loads(seconds_path(study).read_text(encoding="utf-8")))
        hidden, mrr = results.drop_duplicates("seed")["entities"], by_seed(results)
        times = f"{len(hidden)} × {round(hidden.mean())}"
        name = f"{model_of(settings)}, {settings.title}"
        studies[name], means[name] = mrr, means_of(mrr, results, settings)
        read_as = results.loc[results["method"] == "insert", "trained_with"].unique()
        columns = {"loss read as": ", ".join(read_as), "hidden": times}
        comparison.append(headed(compared(mrr, means[name]), settings, **columns))
        methods.append(headed(every_method(mrr, results, seconds, settings), settings))
    if studies:
        write_table("hidden", pd.concat(comparison))
        (BENCHMARKS / "hidden_summary.md").write_text(
            f"{summary(studies, means)}\n", encoding="utf-8"
        )
        counted = counts(studies, means).rename_axis("the default is").reset_index()
        write_table("hidden_counts", counted)
        write_table("hidden_methods", pd.concat(methods))


if __name__ == "__main__":
    with errors_in_one_line("hidden"):
        main()
