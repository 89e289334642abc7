"""Does an insertion serve on a graph? Hide entities, train a PyKEEN model on the others, insert the
hidden ones from a few of their facts, and rank answers (extra ``pykeen``).

``python examples/hidden_study.py umls kinships nations codex_s --seeds 3 --facts 1 3 all``
"""

# %% What is asked
import argparse
import logging
import time
import warnings
from pathlib import Path
from typing import Any

import pandas as pd
import torch
from pykeen.models import ComplEx
from pykeen.training import LCWATrainingLoop
from pykeen.triples import TriplesFactory
from scipy.stats import t
from torch.optim import Adam

import isi

parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
parser.add_argument(
    "graphs", nargs="*", default=["umls"], help="names of graphs, as of `isi.benchmark.hide` (umls)"
)
parser.add_argument("--seeds", type=int, default=3, help="of hidden entities and training (3)")
parser.add_argument(
    "--facts", nargs="+", default=["1", "3", "all"], help="of each entity (1 3 all)"
)
parser.add_argument("--fraction", type=float, default=0.1, help="of the entities, hidden (0.1)")
parser.add_argument("--epochs", type=int, default=40, help="of training (40)")
parser.add_argument("--rate", type=float, default=0.1, help="of learning, with Adam (0.1)")
parser.add_argument(
    "--tables", type=Path, help="existing folder for hidden.csv and hidden_methods.csv"
)
settings = parser.parse_args()

#: Initializers of ``isi.pykeen.insert``; None: its default. ``retrained``: all is trained again.
METHODS = (None, "map", "fold_in", "soft_rs", "er_avg", "mean", "xavier", "retrained")
warnings.simplefilter("ignore")
for package in ("pykeen", "torch_max_mem"):
    logging.getLogger(package).setLevel(logging.ERROR)


# %% ComplEx with cross-entropy over all entities
def trained(factory: TriplesFactory, seed: int) -> ComplEx:
    torch.manual_seed(seed)
    given = {"embedding_dim": 32, "loss": "crossentropy", "random_seed": seed}
    model = ComplEx(triples_factory=factory, regularizer=None, **given)
    loop = LCWATrainingLoop(
        model=model, triples_factory=factory, optimizer=Adam(model.parameters(), lr=settings.rate)
    )
    loop.train(factory, settings.epochs, batch_size=256, use_tqdm=False, pin_memory=False)
    return model.eval()


# %% Known and hidden entities, trained together from the beginning
def retrained(split: isi.benchmark.HiddenSplit, number: int | None, seed: int) -> ComplEx:
    triples = torch.from_numpy(split.ids.insert_triples(number))
    ids = {label: row for row, label in enumerate(split.entities)}
    every = torch.cat([split.known.mapped_triples, triples])
    return trained(TriplesFactory(every, ids, split.known.relation_to_id), seed)


# %% The answers about the hidden entities by each method
def answers(graph: str, seed: int) -> list[dict[str, Any]]:
    split, rows = isi.benchmark.hide(graph, fraction=settings.fraction, seed=seed), []
    done: Any
    model = trained(split.known, seed)
    before = split.evaluate(model).earlier
    for facts in settings.facts:
        number = None if facts == "all" else int(facts)
        for method in METHODS:
            begun = time.process_time()
            if method == "retrained":
                done, expected = retrained(split, number, seed), None
            else:
                given = {"new": split.hidden, "initializer": method, "seed": seed}
                done = isi.pykeen.insert(model, split.known, split.facts_of(number), **given)
                expected = done.harm
            row = {"graph": graph, "seed": seed, "facts": facts, "method": method or "default"}
            row |= {"seconds": time.process_time() - begun, "expected to be lost": expected}
            found = split.evaluate(done)
            row |= {"known ends": found.known, "hidden ones": found.hidden}
            rows.append(row | {"earlier lost": before - found.earlier})
    return rows


# %% Means over seeds: MRR of known ends and of hidden ones, and what that of known triples loses
MEASURES = ["known ends", "hidden ones", "earlier lost"]
table = pd.DataFrame(
    [
        row
        for graph in settings.graphs
        for seed in range(settings.seeds)
        for row in answers(graph, seed)
    ]
).astype({"expected to be lost": float})
groups = table.groupby(["graph", "facts", "method"], sort=False)
means = groups[[*MEASURES, "expected to be lost", "seconds"]].mean()
# half of a 95 % interval of the mean over seeds (Student's t)
halves = groups[MEASURES].sem() * t.ppf(0.975, settings.seeds - 1)
methods = means.join(halves.add_suffix(": ±")).round(3)
print(methods.to_string())


# %% The default beside the best named initializer and the retrained model
def compared(facts: pd.DataFrame) -> pd.Series:
    rows = facts.droplevel(["graph", "facts"])
    named = rows.drop(index=["default", "retrained"])["known ends"].idxmax()
    whose = {"default": "default", "best named": named, "retrained": "retrained"}
    expected = rows.loc["default", "expected to be lost"]
    cells = {"best named is": named, "default: expected to lose": f"{expected:.3f}"}
    for title, method in whose.items():
        row = rows.loc[method]
        cells[title] = f"{row['known ends']:.3f} ± {row['known ends: ±']:.3f}"
        cells[f"{title}: loses"] = f"{row['earlier lost']:.3f} ± {row['earlier lost: ±']:.3f}"
    return pd.Series(cells)


summary = pd.DataFrame(
    {key: compared(facts) for key, facts in methods.groupby(level=[0, 1], sort=False)}
).T
summary.index.names = ["graph", "facts"]
print(summary.to_string())
if settings.tables:
    summary.to_csv(settings.tables / "hidden.csv")
    methods.to_csv(settings.tables / "hidden_methods.csv")
