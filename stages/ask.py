"""Ask every model right after insertion, and tell its answers by what was asked."""

from __future__ import annotations

import pandas as pd

from isi.base import paths, tables
from isi.base.stage import Given, stage
from isi.experiments.executor import compute_of, run, stack_height
from isi.experiments.learning import family_of
from isi.experiments.store import Store
from isi.insertion.tasks import lists
from isi.studies import asking
from isi.studies.asking import AskingTask


@stage
def ask(given: Given, experiment: str) -> None:
    """Ask every model right after insertion, and tell its answers by what was asked."""
    store, family, compute = Store(experiment, given.provenance), family_of(given), compute_of(given)
    listed = f"experiments.{experiment}.initializers"
    names = [name for name in given.raw("initializers") if lists(given, listed, name)]
    insert_triples = store.insert_triples()
    tasks = [
        AskingTask(
            cell, store.theta0(cell, family), store.joint(cell, family),
            {name: store.initial_vectors(name, cell) for name in names}, store.insert_triples_of(cell, insert_triples),
        )
        for cell in store.cells(stack_height(compute))
    ]  # fmt: skip
    asked = pd.concat(run(asking.ask, tasks, compute, f"{experiment}, asked"))
    asked = asked.sort_values(["size", "seed"], kind="stable")
    relation, seed = store.tensors(paths.joint(experiment), "relation", "seed")
    used = asking.used(family, relation, seed.tolist(), store.graph().relations)
    tables.write(paths.asked(experiment), asked, tables.ASKED, given.provenance)
    tables.write(paths.used(experiment), used, tables.USED, given.provenance)


if __name__ == "__main__":
    ask()
