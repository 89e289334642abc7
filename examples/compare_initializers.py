"""Compare initializers on your own graph: train without some entities, insert them,
and ask for what was not given.

``python examples/compare_initializers.py [TRIPLES.csv]``
"""

# %%
import sys
from pathlib import Path

import numpy as np
import pandas as pd

import isi

path = sys.argv[1] if len(sys.argv) > 1 else Path(__file__).parent / "home.csv"
triples = pd.read_csv(path)[["head", "relation", "tail"]].drop_duplicates()

# %% Hide twelve heads with at least four triples; two triples of each are given at its insertion
often = triples["head"].value_counts()
heads = sorted(often.index[(often >= 4) & ~often.index.isin(triples["tail"])])
hidden = np.random.default_rng(0).choice(heads, 12, replace=False).tolist()
known, about = triples[~triples["head"].isin(hidden)], triples[triples["head"].isin(hidden)]
about = about[about["tail"].isin(known["tail"])]
given = about.groupby("head").sample(2, random_state=0)
queries = about.drop(given.index)
true = triples.groupby(["head", "relation"])["tail"].agg(set)

# %% Train without them
home = isi.train(known.to_numpy().tolist())


# %% The reciprocal rank of an answer among all entities, other true answers left out
# Ties count half
def reciprocal_rank(head: str, relation: str, tail: str) -> float:
    scores = {answer.entity: answer.score for answer in home.ask(head, relation, top=10**6).answers}
    others = np.array([score for name, score in scores.items() if name not in true[head, relation]])
    return float(1 / (1 + (others > scores[tail]).sum() + (others == scores[tail]).sum() / 2))


# %% Insert by each initializer, ask, and take the insertion back
rows = []
for name in ("xavier", "mean", "es", "rs", "ers", "soft_hybrid", "map"):
    home.tell(given, entities=hidden, initializer=name)
    ranks = [reciprocal_rank(*query) for query in queries.itertuples(index=False)]
    harm = home.interference()
    rows.append((name, np.mean(ranks), harm.h_old - harm.h_cur if harm else 0))
    home.undo()
table = pd.DataFrame(rows, columns=["initializer", "MRR of new entities", "earlier MRR lost"])
print(f"{len(queries)} queries about {len(hidden)} entities, {len(given)} triples given")
print(table.round(3).to_string(index=False))
