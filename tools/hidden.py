"""Write docs/benchmarks/hidden*.* from the results of the stage `insert_hidden`.

``hidden.csv`` compares the default of ``isi.pykeen.insert`` with the best initializer and with
training from scratch, and says which bars it misses; ``hidden_summary.md`` and
``hidden_counts.csv`` count these misses, and ``hidden_methods.csv`` has every method.
"""

import json
from collections.abc import Mapping

import numpy as np
import pandas as pd
from pykeen.models import model_resolver
from scipy.stats import t, ttest_1samp

from isi.benchmark.study import HIDDEN_ENTITIES, Hidden, seconds_path, study_of
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


def means_of(mrr: pd.DataFrame, results: pd.DataFrame, settings: Hidden) -> pd.DataFrame:
    """Means over seeds, a row for each number of ``facts``. ``known_ends``: MRR with the default;
    ``best``: the highest with a named initializer, which is ``best_named``; ``retrained``: after
    training from scratch. ``loss`` and ``best_loss``: what the MRR of earlier triples loses with
    the default and that initializer; ``estimated``: what the selection of the default expects to
    lose. NaN: not measured.
    """
    rows = []
    for number in (str(number or ALL) for number in settings.max_insert_triples):
        ends = mrr[number, "known"].groupby("method").mean()
        best = str(ends[settings.initializers].idxmax())
        rows.append(
            {
                "facts": number,
                "known_ends": ends["insert"],
                "best": ends[best],
                "best_named": best,
                "best_loss": loss(mrr, best, number).mean(),
                "retrained": ends.get("retrained", np.nan),
                "loss": loss(mrr, "insert", number).mean(),
                "estimated": estimated(results, number),
            }
        )
    return pd.DataFrame(rows)


def most_lost(means: pd.DataFrame) -> pd.Series:
    """By row: the bar of what earlier triples lose."""
    return (means["facts"] == ALL).map({True: MOST_LOST, False: MOST_LOST_OF_FEW})


def differences(means: pd.DataFrame) -> pd.DataFrame:
    """By bar: the loss above its bar; the estimated minus the real loss; the MRR of known ends
    minus that of the best initializer, and minus that after training from scratch.
    """
    return pd.DataFrame(
        {
            "loss": means["loss"] - most_lost(means),
            "estimate": means["estimated"] - means["loss"],
            "known ends": means["known_ends"] - means["best"],
            "retraining": means["known_ends"] - means["retrained"],
        }
    )


def misses(means: pd.DataFrame) -> pd.DataFrame:
    """The ``differences`` of the bars that the default misses; NaN for the others."""
    by_bar, losses = differences(means), means[["estimated", "loss"]]
    low, high = losses.min(axis=1), losses.max(axis=1)
    is_missed = pd.DataFrame(
        {
            "loss": by_bar["loss"] > 0,
            "estimate": (high > SMALL) & (high > RATIO * low),
            "known ends": by_bar["known ends"] < -BELOW_BEST,
            "retraining": by_bar["retraining"] < 0,
        }
    )
    return by_bar.where(is_missed)


def compared(mrr: pd.DataFrame, means: pd.DataFrame) -> pd.DataFrame:
    """A row for each number of insert triples:
    the default, the best initializer and training from scratch.
    """
    rows = []
    for (_, row), (_, missed) in zip(means.iterrows(), misses(means).iterrows(), strict=True):
        number = row["facts"]
        known_ends = mrr.loc["insert"][number, "known"]
        minus_retrained, again = "", np.nan
        if number == ALL and "retrained" in mrr.index:
            minus_retrained = with_interval(known_ends - mrr.loc["retrained"][number, "known"])
            again = loss(mrr, "retrained", number).mean()
        rows.append(
            {
                "facts": number,
                "known ends: default": with_interval(known_ends),
                "best named": f"{row['best']:.3f} ({row['best_named']})",
                "retrained": number_or_blank(row["retrained"]),
                "default minus retrained": minus_retrained,
                "hidden ones: default": with_interval(mrr.loc["insert"][number, "hidden"]),
                "earlier": f"{mrr.loc['nothing'][ALL, 'earlier'].mean():.3f}",
                "loss: default": with_interval(loss(mrr, "insert", number)),
                "loss: estimated": number_or_blank(row["estimated"]),
                "best named's": f"{row['best_loss']:.3f}",
                "retraining's": number_or_blank(again),
                "misses": "; ".join(f"{bar} {by:+.3f}" for bar, by in missed.dropna().items()),
            }
        )
    return pd.DataFrame(rows)


def summary(studies: Mapping[str, pd.DataFrame], means: pd.DataFrame) -> str:
    """Sentences on the default, from ``by_seed`` of each study by name, and ``means_of`` of all
    with a column ``study``.
    """
    counted = counts(studies, means)["rows"]
    tested = len(against_retraining(studies))
    sentences = [
        "With all facts, the MRR of known ends is significantly higher with the default than "
        f"after training from scratch in {counted[HIGHER]} of {tested} studies, and significantly "
        f"lower in {counted[LOWER]} (t-tests paired by seed; p below {LEVEL:g} after Holm's "
        f"correction over the {tested} studies).",
        f"In {counted[BOTH]} of {len(means)} rows, the default is within {BELOW_BEST:g} of the "
        "best named initializer and within the bar of the loss.",
    ]
    by_bar, missed = differences(means), misses(means).abs()
    for bar, words in SENTENCES.items():
        number, end = missed[bar].count(), ""
        if number:
            row = means.loc[missed[bar].idxmax()]
            end = f", at most by {missed[bar].max():.3f} ({row['study']}, facts: {row['facts']})"
        sentences.append(f"{words} in {number} of {by_bar[bar].count()} rows{end}.")
        if bar == "known ends":
            sentences.append(
                f"In {harmful(means)} of these, that initializer exceeds the bar of the loss."
            )
    return " ".join(sentences)


#: Rows of ``counts``.
NEAR, SAFE, BOTH = "near the best named", "within the bar of the loss", "both"
HIGHER, LOWER = "above retraining", "below retraining"


def counts(studies: Mapping[str, pd.DataFrame], means: pd.DataFrame) -> pd.DataFrame:
    """In how many ``rows`` ``of`` all the default is at most ``BELOW_BEST`` below the best named
    initializer, at most the bar above the loss, or both; and in how many studies it is
    significantly above or below training from scratch. Arguments as in ``summary``.
    """
    is_met = misses(means)[["known ends", "loss"]].isna()
    tested = against_retraining(studies)
    significant = tested.loc[tested["corrected"] < LEVEL, "difference"]
    rows = {
        NEAR: is_met["known ends"].sum(),
        SAFE: is_met["loss"].sum(),
        BOTH: is_met.all(axis=1).sum(),
        HIGHER: (significant > 0).sum(),
        LOWER: (significant < 0).sum(),
    }
    of_all = 3 * [len(means)] + 2 * [len(tested)]
    return pd.DataFrame({"rows": rows.values(), "of": of_all}, list(rows))


def harmful(means: pd.DataFrame) -> int:
    """In how many rows the best initializer of known ends has a bar's more MRR than the default,
    but a loss above its bar.
    """
    is_far = misses(means)["known ends"].notna()
    return int((is_far & (means["best_loss"] > most_lost(means))).sum())


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
    texts = took.map("{:.3f}".format).where(took < 1, took.map("{:.1f}".format))
    return table.assign(s=texts.where(took.notna(), "")).reset_index(drop=True)


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
        name = f"{model_of(settings)}, {settings.title}"
        studies[name], means[name] = mrr, means_of(mrr, results, settings)
        read_as = results.loc[results["method"] == "insert", "trained_with"].unique()
        times = f"{len(hidden)} × {round(hidden.mean())}"
        columns = {"loss read as": ", ".join(read_as), "hidden": times}
        comparison.append(headed(compared(mrr, means[name]), settings, **columns))
        methods.append(headed(every_method(mrr, results, seconds, settings), settings))
    if studies:
        of_all = pd.concat(means, names=["study"]).reset_index("study").reset_index(drop=True)
        sentences = f"{summary(studies, of_all)}\n"
        (BENCHMARKS / "hidden_summary.md").write_text(sentences, encoding="utf-8")
        counted = counts(studies, of_all).rename_axis("the default is").reset_index()
        write_table("hidden", pd.concat(comparison))
        write_table("hidden_counts", counted)
        write_table("hidden_methods", pd.concat(methods))


if __name__ == "__main__":
    with errors_in_one_line("hidden"):
        main()
