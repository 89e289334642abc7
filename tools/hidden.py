"""Turn what the stage `hide` found into the table of docs/benchmarks/hidden.md, with who is first in words."""

from __future__ import annotations

import json
from pathlib import Path

import pandas as pd

from isi.analyses.hidden_entities import HIDDEN_ENTITIES, Hidden, seconds_path
from isi.params import load, load_beyond
from isi.process import one_line

TABLE = Path(__file__).parent.parent / "docs" / "benchmarks" / "hidden.md"
ALL = "all"
#: What is asked for, and how its columns begin.
ASKED = {"known": "known ends", "hidden": "hidden ones"}


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
    told = found["told"].map({number: str(number) for number in how.max_insert_triples if number}).fillna(ALL)
    rows = found.assign(told=told, method=found["method"].astype(str), asked=found["asked"].astype(str))
    order = list(dict.fromkeys(rows["method"]))
    return rows.groupby(["method", "asked", "told"])[["mrr", "hits_at_10"]].mean().unstack([1, 2]).loc[order]


def rows_of(found: pd.DataFrame, seconds: pd.DataFrame, how: Hidden) -> pd.DataFrame:
    """The rows of a graph."""
    mean, default = means(found, how), default_of(found)
    levels = [str(number) if number else ALL for number in how.max_insert_triples]
    shown = {"": [label(method, how, default) for method in mean.index]}
    for asked, what in ASKED.items():
        shown |= {f"{what}, {told}": _rounded(mean["mrr", asked, told]) for told in levels}
    shown["Hits@10"] = _rounded(mean["hits_at_10", "known", ALL])
    shown["earlier"] = _rounded(mean["mrr", "earlier", ALL])
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
    mean, default = means(found, how)["mrr"], default_of(found)
    once = found.drop_duplicates("seed")
    sentences = [f"**{how.title}** ({len(once)} times {round(once['entities'].mean())} hidden)."]
    for number in how.max_insert_triples:
        told = str(number) if number else ALL
        ranked = mean["known", told].dropna().sort_values(ascending=False)
        still = [method for method in ranked.index if "rows" not in method and method != "retrained"]
        named = list(dict.fromkeys([ranked.index[0], still[0]]))
        said = [f"{label(method, how, default)} ({ranked[method]:.3f})" for method in named]
        sentence = f"Told {told}, first is " + ", and of those that train nothing ".join(said)
        if "insert" not in named:
            place = list(ranked.index).index("insert") + 1
            sentence += f"; the default stands at place {place} of {len(ranked)} ({ranked['insert']:.3f})"
        sentences.append(f"{sentence}.")
    crowded, again = (mean["earlier", ALL][method] for method in ("insert", "retrained"))
    sentences.append(
        f"Earlier triples have {crowded:.3f} with the default, and {again:.3f} where all is trained again."
    )
    return " ".join(sentences)


def main() -> None:
    entries = {
        name: how for name, how in load_beyond(load()).hidden.items() if HIDDEN_ENTITIES.path(graph=name).exists()
    }
    parts, sentences = [], []
    for name, how in entries.items():
        found = HIDDEN_ENTITIES.read(graph=name)
        seconds = pd.DataFrame(json.loads(seconds_path(name).read_text(encoding="utf-8")))
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
    with one_line("hidden"):
        main()
