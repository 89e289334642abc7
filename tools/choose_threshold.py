"""How often the best answer about a hidden object is right, by its calibrated probability.

Objects of AI2-THOR's final model are hidden one by one, and inserted from one to three of their
triples. A best answer that was not given is right if it is another known triple of the object.
The table is ``docs/benchmarks/threshold.csv``.
"""

import numpy as np
import pandas as pd
import torch
from tqdm import tqdm

from isi.live.bundle import read
from isi.live.embedding import LiveEmbedding
from isi.live.loaded import LoadedEmbedding
from isi.tables import paths
from tools.docs import write_table

OBJECTS, MOST_FACTS = 80, 3
THRESHOLDS = (0.0, 0.1, 0.2, 0.3, 0.4, 0.5)


def main() -> None:
    torch.set_num_threads(1)
    bundle, _ = read(paths.final_model("ai2thor"))
    known, rng = LoadedEmbedding(**vars(bundle)), np.random.default_rng(0)
    whole = LiveEmbedding(known)
    whole.prepare(progress=True)
    choices = whole.home.read("SELECT * FROM choice")
    store = "INSERT INTO choice VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?)"
    triples, rows = known.named_triples(), []
    for row in tqdm(
        rng.permutation(np.flatnonzero(np.array(known.kinds) == "object"))[:OBJECTS], "objects"
    ):
        name = known.entity_names[row]
        about = [triple for triple in triples if name in (triple[0], triple[2])]
        number = min(int(rng.integers(1, MOST_FACTS + 1)), len(about) - 1)
        facts = [about[place] for place in rng.permutation(len(about))[:number]]
        live = LiveEmbedding(known.part(np.delete(np.arange(len(known.entities)), row)))
        live.home.connection.executemany(store, choices)
        if not number:
            continue
        live.insert(name, facts, kind="object", new=True)
        for relation in known.relation_names:
            true = {tail for head, other, tail in about if (head, other) == (name, relation)} - {
                fact[2] for fact in facts
            }
            best = next(
                each
                for each in live.ask(name, relation, top=len(known.entities)).answers
                if not each.given
            )
            rows.append((best.probability or 0.0, best.entity in true, bool(true)))
    probability, right, answerable = map(np.array, zip(*rows, strict=True))
    table = []
    for threshold in THRESHOLDS:
        stated = probability >= threshold
        shares = (
            right[stated & answerable].mean(),
            right[stated].mean(),
            (stated & answerable).sum() / answerable.sum(),
        )
        table.append([f"{threshold:.0%}", *(f"{100 * share:.0f}" for share in shares)])
    headers = [
        "threshold",
        "right, % of queries with an answer",
        "right, % of all",
        "answered, % of queries with an answer",
    ]
    write_table("threshold", pd.DataFrame(table, columns=headers))


if __name__ == "__main__":
    main()
