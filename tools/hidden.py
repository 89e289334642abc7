"""Write docs/benchmarks/hidden.md from the results of the stage `insert_hidden`: a table, and the best methods."""

import json
from collections.abc import Iterator

import pandas as pd

from isi.analyses.hidden_entities import HIDDEN_ENTITIES, Hidden, seconds_path
from isi.params import load, load_beyond
from isi.process import errors_in_one_line
from tools.docs import BENCHMARKS, write_table

ALL = "all"
#: Values of ``asked`` (known or hidden answers), and the first words of the titles of their columns.
QUERIES = {"known": "known ends", "hidden": "hidden ones"}


def label(method: str, settings: Hidden) -> str:
    """Title of a method."""
    insert = "`isi.pykeen.insert`"
    return {
        "nothing": "nothing inserted",
        "insert": f"{insert}, its default",
        "own": "PyKEEN's own initialization",
        "insert_new_rows": f"{insert} and {settings.epochs} epochs of the new rows",
        "own_new_rows": f"PyKEEN's own and {settings.epochs} epochs of the new rows",
        "own_all_rows": f"PyKEEN's own and {settings.epochs} epochs of all rows",
        "retrained": "retrained from scratch",
    }.get(method, f"{insert}: `{method}`")


def means(results: pd.DataFrame, settings: Hidden) -> pd.DataFrame:
    """Means over seeds: a row for each method, columns (measure, ``asked``, maximum number of insert triples)."""
    numbers = results["told"].map({number: str(number) for number in settings.max_insert_triples if number}).fillna(ALL)
    rows = results.assign(told=numbers).astype({"method": str, "asked": str})
    mean = rows.groupby(["method", "asked", "told"])[["mrr", "hits_at_10"]].mean().unstack([1, 2])
    return mean.loc[rows["method"].unique()]


def table_of(mean: pd.DataFrame, seconds: pd.DataFrame, settings: Hidden) -> pd.DataFrame:
    """The rows of a graph: MRR and Hits@10 as text, and CPU seconds with all insert triples, by method."""
    took = seconds[seconds["told"].isna()].set_index("method")["seconds"].reindex(mean.index)
    columns = {f"{title}, {number or ALL}": mean["mrr", queries, str(number or ALL)]
               for queries, title in QUERIES.items() for number in settings.max_insert_triples}  # fmt: skip
    columns |= {"Hits@10": mean["hits_at_10", "known", ALL], "earlier": mean["mrr", "earlier", ALL]}
    table = pd.DataFrame(columns).map(lambda value: "" if pd.isna(value) else f"{value:.3f}")
    table.insert(0, "", [label(method, settings) for method in mean.index])
    return table.assign(
        s=took.map(lambda value: "" if pd.isna(value) else f"{value:{'.3f' if value < 1 else '.1f'}}")
    ).reset_index(drop=True)


def sentences_of(mean: pd.DataFrame, settings: Hidden) -> Iterator[str]:
    """By number of insert triples: best method, best without training, rank of the default; then earlier triples."""
    for number in settings.max_insert_triples:
        ranked = mean["mrr", "known", str(number or ALL)].dropna().sort_values(ascending=False)
        untrained = [method for method in ranked.index if "rows" not in method and method != "retrained"]
        named = list(dict.fromkeys([ranked.index[0], untrained[0]]))
        labels = [f"{label(method, settings)} ({ranked[method]:.3f})" for method in named]
        triples = f"{number or ALL} insert triple{'s' if number != 1 else ''}"
        sentence = f"With {triples}, best is " + ", and best without training ".join(labels)
        if "insert" not in named:
            place = list(ranked.index).index("insert") + 1
            sentence += f"; the default has rank {place} of {len(ranked)} ({ranked['insert']:.3f})"
        yield f"{sentence}."
    before, inserted, again = (mean["mrr", "earlier", ALL][method] for method in ("nothing", "insert", "retrained"))
    yield (
        f"Earlier triples: MRR {before:.3f} before, {inserted:.3f} with the default, {again:.3f} after training from "
        "scratch."
    )


def main() -> None:
    tables, lines = [], []
    for name, settings in load_beyond(load()).hidden.items():
        if not HIDDEN_ENTITIES.path(graph=name).exists():
            continue
        results = HIDDEN_ENTITIES.read(graph=name)
        seconds = pd.DataFrame(json.loads(seconds_path(name).read_text(encoding="utf-8")))
        mean, times = means(results, settings), results.drop_duplicates("seed")["entities"]
        table = table_of(mean, seconds, settings)
        table.insert(0, "graph", [settings.title, *[""] * (len(table) - 1)])
        tables.append(table)
        title = f"- **{settings.title}** ({len(times)} times {round(times.mean())} hidden)."
        lines.append(" ".join([title, *sentences_of(mean, settings)]))
    if tables:
        write_table(BENCHMARKS / "hidden.md", pd.concat(tables).fillna(""), 2, "\n" + "\n".join(lines) + "\n")


if __name__ == "__main__":
    with errors_in_one_line("hidden"):
        main()
