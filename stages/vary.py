"""Run experiments again under other conditions, beside their main runs."""

from __future__ import annotations

import numpy as np
import pandas as pd

from isi.base import paths, tables
from isi.base.stage import Given, stage
from isi.experiments.executor import compute_of, run, stack_height
from isi.experiments.learning import family_of, learning
from isi.experiments.store import Store
from isi.insertion.tasks import Inserting, inserting, inserting_with, measured_at_once
from isi.studies.variants import Variant, VariantTask, changed, repeat, some_of
from isi.words import Words, load_vectors, look_up


@stage
def vary(given: Given, variant: str) -> None:
    """Run experiments again under other conditions: train if need be, insert, and fine-tune until convergence."""
    study, compute, runs, asked = given.section(f"variants.{variant}", Variant), compute_of(given), [], []
    own = changed(given, study.changes, f"variants.{variant}.changes")
    for experiment in study.experiments:
        for each, answered in run(repeat, tasks(own, study, experiment), compute, f"{variant}, {experiment}"):
            runs.append(each.assign(experiment=experiment))
            asked.append(answered.assign(experiment=experiment))
    ordered = pd.concat(runs).sort_values(["experiment", "model", "size", "seed", "session", "epoch", "scope"])
    tables.write(paths.variant(variant), ordered, tables.VARIANTS, given.provenance)
    answers = pd.concat(asked).sort_values(["experiment", "size", "seed"], kind="stable")
    tables.write(paths.variant_asked(variant), answers, tables.VARIANTS_ASKED, given.provenance)


def tasks(given: Given, study: Variant, experiment: str) -> list[VariantTask]:
    """A variant of one experiment, over its cells."""
    store, family = Store(experiment, given.provenance), family_of(given)
    table, words = store.insert_triples(), words_of(given, study, store)
    how = {name: how_of(given, study, name) for name in study.initializers}
    found = []
    for cells in store.cells(stack_height(compute_of(given)), study.size, study.seeds):
        start = learning(given) if study.trains else (store.theta0(cells, family), store.joint(cells, family))
        told = store.insert_triples_of(cells, table)
        found.append(VariantTask(cells, start, told, some_of(told, study.told, cells, given.seed), words, how))
    return found


def how_of(given: Given, study: Variant, initializer: str) -> Inserting:
    """How a variant inserts with one initializer, with options of its own or those of the main runs."""
    if initializer not in study.options:
        return inserting(given, initializer, finetuned=study.finetuned)
    how = inserting_with(given, initializer, study.options[initializer], f"options.{initializer}")
    return how if study.finetuned else measured_at_once(how)


def words_of(given: Given, study: Variant, store: Store) -> np.ndarray:
    """Word vectors of the entities: the main runs', or the variant's own."""
    if not study.speaks:
        return store.words()
    return look_up(load_vectors(given.section("words", Words)), list(store.entities()["phrase"])).vectors


if __name__ == "__main__":
    vary()
