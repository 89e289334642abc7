"""Turn what the stage `hide` found into the table of docs/benchmarks/hidden.md, with who is first in words."""

from __future__ import annotations

import json
from pathlib import Path

import pandas as pd

from isi.base import paths, tables
from isi.studies.beyond import load
from isi.studies.hidden import HIDDEN, Hidden

TABLE = Path(__file__).parent.parent / "docs" / "benchmarks" / "hidden.md"
ALL = "all"
#: What is asked, and what its columns are called.
ASKED = {
    "known": "MRR of known ends",
    "hidden": "MRR of hidden entities",
    "earlier": "MRR of earlier triples",
}


def label(method: str, how: Hidden, default: str) -> str:
    """What a method is called."""
    insert = "`isi.pykeen.insert`"
    return {
        "insert": f"{insert}: {default}, its default",
        "own": "PyKEEN's own initialization",
        "insert_new_rows": f"{insert}, then {how.epochs} epochs of the new rows",
        "own_new_rows": f"PyKEEN's own, then {how.epochs} epochs of the new rows",
        "own_all_rows": f"PyKEEN's own, then {how.epochs} epochs of all rows",
        "retrained": "all trained again",
    }.get(method, f"{insert}: `{method}`")


def means(found: pd.DataFrame, how: Hidden) -> pd.DataFrame:
    """Means over seeds by method: of each measure (columns: what is asked, measure, told)."""
    told = found["told"].map({number: str(number) for number in how.told if number}).fillna(ALL)
    rows = found.assign(told=told, method=found["method"].astype(str), asked=found["asked"].astype(str))
    order = list(dict.fromkeys(rows["method"]))
    return rows.groupby(["method", "asked", "told"])[["mrr", "hits_at_10"]].mean().unstack([1, 2]).loc[order]


def rows_of(found: pd.DataFrame, seconds: pd.DataFrame, how: Hidden) -> pd.DataFrame:
    """The rows of a graph."""
    mean, default = means(found, how), default_of(found)
    levels = [str(number) if number else ALL for number in how.told]
    shown = {"": [label(method, how, default) for method in mean.index]}
    for told in levels:
        shown[f"{ASKED['known']}, {told} told"] = _rounded(mean["mrr", "known", told])
    shown["Hits@10"] = _rounded(mean["hits_at_10", "known", ALL])
    for asked in ("hidden", "earlier"):
        shown[f"{ASKED[asked]}, all told"] = _rounded(mean["mrr", asked, ALL])
    took = seconds[seconds["told"].isna()].set_index("method")["seconds"]
    shown["s"] = [f"{took[method]:.3f}" if took[method] < 1 else f"{took[method]:.1f}" for method in mean.index]
    return pd.DataFrame(shown).fillna("")


def default_of(found: pd.DataFrame) -> str:
    """The initializer that was taken where none was named."""
    (name,) = found.loc[found["method"] == "insert", "initializer"].unique()
    return f"`{name}`"


def _rounded(values: pd.Series) -> list[str]:
    return ["" if pd.isna(value) else f"{value:.3f}" for value in values]


def words(found: pd.DataFrame, how: Hidden) -> str:
    """Who is first, and where the default stands; who trains nothing is told from who does."""
    mean, default = means(found, how)["mrr"]["known"], default_of(found)
    once = found.drop_duplicates("seed")
    still = [method for method in mean.index if "rows" not in method and method != "retrained"]
    sentences = [f"**{how.title}** ({len(once)} times {round(once['entities'].mean())} entities)."]
    for number in how.told:
        told = str(number) if number else ALL
        ranked = mean[told].dropna().sort_values(ascending=False)
        first, best = ranked.index[0], ranked[still].sort_values(ascending=False).index[0]
        place = list(ranked.index).index("insert") + 1
        sentence = f"Told {told}: first is {label(first, how, default)} ({ranked.iloc[0]:.3f})"
        if first != best:
            sentence += f", of those that train nothing {label(best, how, default)} ({ranked[best]:.3f})"
        if "insert" not in (first, best):
            sentence += f"; the default stands at place {place} of {len(ranked)} ({ranked['insert']:.3f})"
        sentences.append(f"{sentence}.")
    return " ".join(sentences)


def main() -> None:
    entries = {name: how for name, how in load().hidden.items() if paths.hidden(name).exists()}
    parts, sentences = [], []
    for name, how in entries.items():
        found = tables.read(paths.hidden(name), HIDDEN)
        seconds = pd.DataFrame(json.loads(paths.hidden_seconds(name).read_text(encoding="utf-8")))
        parts.append(rows_of(found, seconds, how).assign(graph=[how.title, *[""] * (found["method"].nunique() - 1)]))
        sentences.append(f"- {words(found, how)}")
    if not parts:
        return
    shown = pd.concat(parts).set_index("graph").reset_index().fillna("")
    aligned = ["left", "left", *["right"] * (shown.shape[1] - 2)]
    text = shown.to_markdown(index=False, disable_numparse=True, colalign=aligned)
    TABLE.write_text(text + "\n\n" + "\n".join(sentences) + "\n", encoding="utf-8")
    print(text)


if __name__ == "__main__":
    main()
