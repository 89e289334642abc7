"""Write docs/benchmarks/hidden*.* from the results of the stage `insert_hidden`.

``hidden.csv`` compares the default of ``isi.pykeen.insert`` with the best initializer and with
training from scratch, ``hidden_summary.md`` sums it up, and ``hidden_methods.csv`` has every
method.
"""

import json
from collections.abc import Mapping

import pandas as pd
from pykeen.models import model_resolver
from scipy.stats import t

from isi.extras.hidden_entities import HIDDEN_ENTITIES, Hidden, seconds_path, study_of
from isi.params import load, load_beyond
from isi.process import errors_in_one_line
from tools.docs import BENCHMARKS, write_table

ALL = "all"
#: Values of ``asked`` (known or hidden answers), and the first words of the titles of their
#: columns.
QUERIES = {"known": "known ends", "hidden": "hidden ones"}


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


def by_seed(results: pd.DataFrame) -> pd.DataFrame:
    """MRR by seed: rows (method, seed), columns (maximum number of insert triples, ``asked``)."""
    numbers = results["told"].map(lambda number: ALL if pd.isna(number) else f"{number:.0f}")
    rows = results.assign(told=numbers).astype({"method": str, "asked": str})
    table: pd.DataFrame = rows.pivot(
        index=["method", "seed"], columns=["told", "asked"], values="mrr"
    )
    return table


def interval(values: pd.Series) -> tuple[float, float]:
    """Mean over seeds, and the half width of its 95 % interval (Student's t)."""
    return values.mean(), t.ppf(0.975, len(values) - 1) * values.sem()


def with_interval(values: pd.Series) -> str:
    return "{:.3f} ± {:.3f}".format(*interval(values))


def loss(mrr: pd.DataFrame, method: str, number: str) -> pd.Series:
    """By seed: the MRR of earlier triples before the insertion, minus that after it."""
    return mrr.loc["nothing"][ALL, "earlier"] - mrr.loc[method][number, "earlier"]


def model_of(settings: Hidden) -> str:
    return model_resolver.lookup(settings.training.model).__name__


def compared(mrr: pd.DataFrame, settings: Hidden) -> pd.DataFrame:
    """A row for each number of insert triples:
    the default, the best initializer and training from scratch.
    """
    rows = []
    for number in (str(number or ALL) for number in settings.max_insert_triples):
        ends = mrr[number, "known"].groupby("method").mean()
        best, with_all = str(ends[settings.initializers].idxmax()), number == ALL
        rows.append(
            {
                "facts": number,
                "known ends: default": with_interval(mrr.loc["insert"][number, "known"]),
                "best named": f"{ends[best]:.3f} ({best})",
                "retrained": f"{ends['retrained']:.3f}" if with_all else "",
                "hidden ones: default": with_interval(mrr.loc["insert"][number, "hidden"]),
                "earlier": f"{mrr.loc['nothing'][ALL, 'earlier'].mean():.3f}",
                "loss: default": with_interval(loss(mrr, "insert", number)),
                "best named's": f"{loss(mrr, best, number).mean():.3f}",
                "retraining's": f"{loss(mrr, 'retrained', number).mean():.3f}" if with_all else "",
            }
        )
    return pd.DataFrame(rows)


def summary(studies: Mapping[str, pd.DataFrame]) -> str:
    """Sentences on the default; ``by_seed`` of each study by name."""
    better, worse, losses = 0, 0, {}
    for name, mrr in studies.items():
        mean, half = interval(mrr.loc["insert"][ALL, "known"] - mrr.loc["retrained"][ALL, "known"])
        better, worse = better + (mean > half), worse + (mean < -half)
        numbers = mrr.columns.get_level_values("told").unique()
        losses |= {(name, number): loss(mrr, "insert", number).mean() for number in numbers}
    of_all, of_few = (
        max(
            (lost, name, number)
            for (name, number), lost in losses.items()
            if (number == ALL) == with_all
        )
        for with_all in (True, False)
    )
    return (
        "With all facts, the MRR of known ends is significantly higher with the default than "
        f"after training from scratch in {better} of {len(studies)} studies, and significantly "
        f"lower in {worse} (paired 95 % intervals over seeds). The default's largest loss of "
        f"earlier triples is {of_all[0]:.3f} ({of_all[1]}). With fewer facts, "
        f"the largest loss is {of_few[0]:.3f} ({of_few[1]}, facts: {of_few[2]})."
    )


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
    table = pd.DataFrame(columns, mean.index).map(
        lambda value: "" if pd.isna(value) else f"{value:.3f}"
    )
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
    comparison, methods, studies = [], [], {}
    entries = load_beyond(load()).hidden
    for study in entries:
        if not HIDDEN_ENTITIES.path(study=study).exists():
            continue
        settings = study_of(entries, study)
        results = HIDDEN_ENTITIES.read(study=study)
        seconds = pd.DataFrame(json.loads(seconds_path(study).read_text(encoding="utf-8")))
        hidden, mrr = results.drop_duplicates("seed")["entities"], by_seed(results)
        times = f"{len(hidden)} × {round(hidden.mean())}"
        studies[f"{model_of(settings)}, {settings.title}"] = mrr
        comparison.append(headed(compared(mrr, settings), settings, hidden=times))
        methods.append(headed(every_method(mrr, results, seconds, settings), settings))
    if studies:
        write_table("hidden", pd.concat(comparison))
        (BENCHMARKS / "hidden_summary.md").write_text(f"{summary(studies)}\n", encoding="utf-8")
        write_table("hidden_methods", pd.concat(methods))


if __name__ == "__main__":
    with errors_in_one_line("hidden"):
        main()
