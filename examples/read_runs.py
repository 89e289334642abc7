"""Read the measures of all runs, and ask a few questions of your own.

Run it in the folder of the project, or in quick/: `python examples/read_runs.py`. Editors with
notebooks, such as VS Code, PyCharm and Jupyter with Jupytext, show each part after `# %%` as a
cell.
"""

# %% [markdown]
# One file for each initializer, `data/runs/EXPERIMENT/INITIALIZER.parquet`, and `joint.parquet` for
# the joint model.

# %%
from pathlib import Path

import pandas as pd

# of params.yaml: an experiment, two initializers to compare
EXPERIMENT, ONE, OTHER = "ai2thor", "es", "xavier"
FOLDER = Path("data/runs") / EXPERIMENT

files = [path for path in sorted(FOLDER.glob("*.parquet")) if "." not in path.stem]
if not files:
    raise SystemExit(
        f"{FOLDER}: no runs here: run `make repro` or `make quick` first, then this in that folder"
    )
runs = pd.concat(
    [pd.read_parquet(path).assign(model=path.stem) for path in files], ignore_index=True
)
print(f"{len(runs):,} rows of {', '.join(runs['model'].unique())}\n")

# %% [markdown]
# A row holds the measures of one model at one epoch of one run, over the queries of one scope.
#
# | column | meaning |
# | --- | --- |
# | `model` | the initializer; `joint`: trained on all triples, the upper reference (epoch 0 only) |
# | `size` | abs(ξ), the number of entities that a session inserts |
# | `seed` | the repeat: each has its own splits and novel entities, equal for all initializers |
# | `epoch` | epochs of fine-tuning; 0: right after insertion |
# | `scope` | the queries, see below |
# | `mrr` | the paper's measure in [0, 1]: other true triples are left out; null without queries |
# | `mrr_entity`, `mrr_relation` | its halves: queries for entities, and for relations |
# | `mrr_star`, `mrr_star_entity`, `mrr_star_relation` | equation 7 with counts, the same way |
# | `queries` | the number of triples; each gives three queries: head, relation, tail |
#
# Scopes: `known`, test triples of known entities alone; `novel`, every triple of the novel entities
# but insert triples; `weighted`, both; `held_out`, all test triples; `novel_held_out`, those of
# novel entities that are never trained on; `known_closed`, as `known`, with known candidates alone.

# %% Right after insertion: means over sizes and seeds, in points
immediate = runs[runs["epoch"] == 0]
print(
    (
        100 * immediate.pivot_table(values="mrr", index="model", columns="scope", observed=True)
    ).round(2),
    "\n",
)

# %% By the number of inserted entities, queries about the novel ones
novel = immediate[immediate["scope"] == "novel"]
print((100 * novel.pivot_table(values="mrr", index="model", columns="size")).round(2), "\n")

# %% Two initializers
# The same seeds have the same entities and queries, so their differences are paired
values = novel.set_index(["model", "size", "seed"])["mrr"]
differences = 100 * (values[ONE] - values[OTHER]).dropna()
error = differences.std() / len(differences) ** 0.5
print(
    f"{ONE} - {OTHER}: {differences.mean():+.2f} ± {1.96 * error:.2f} points "
    f"over {len(differences)} runs\n"
)

# %% Learning curves
# Held-out queries about novel entities, in runs that were fine-tuned for all epochs
full = runs.groupby(["model", "size", "seed"])["epoch"].transform("max") == runs["epoch"].max()
curves = (
    runs[full & (runs["scope"] == "novel_held_out")]
    .groupby(["epoch", "model"])["mrr"]
    .mean()
    .unstack()
)
print((100 * curves).iloc[:: max(1, len(curves) // 5)].round(2), "\n")
# curves.plot()  # needs matplotlib

# %% Which entities were hardest to insert?
# Runs that insert one entity alone; `entity` is a row number of the graph's table of entities
names = pd.read_parquet(Path("data/graph") / EXPERIMENT / "entities.parquet")["entity"].astype(str)
alone = pd.read_parquet(Path("data/sessions") / EXPERIMENT / "novel.parquet").query("size == 1")
inserted = novel[novel["model"] == ONE].merge(alone, on=["size", "seed"]).dropna(subset="mrr")
hardest = (
    inserted.assign(entity=inserted["entity"].map(names))
    .groupby("entity")["mrr"]
    .agg(["mean", "size"])
)
print(
    hardest.rename(columns={"mean": "MRR", "size": "insertions"}).sort_values("MRR").head().round(3)
)
