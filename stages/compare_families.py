"""Train the joint model of one embedding family, and measure it over all queries."""

from __future__ import annotations

from dataclasses import replace

import pandas as pd

from isi.base import paths, tables
from isi.base.params import Count
from isi.base.stage import Given, stage
from isi.experiments.cells import JOINT, Vectors
from isi.experiments.executor import compute_of, run, stack_height
from isi.experiments.learning import LearningTask, learn_joint, learning
from isi.experiments.store import Store
from isi.studies.families import FamilyTask, Trained, measure, rows


@stage
def compare_families(given: Given, experiment: str, family: str) -> None:
    """Train the joint model of one embedding family, and measure it over all queries."""
    trained, compute = given.section(f"compare_families.families.{family}", Trained), compute_of(given)
    store = Store(experiment, given.provenance)
    first = store.cells(stack_height(compute), seeds=given.section("compare_families.seeds", Count))
    cells = [replace(cell, size=JOINT, novel=cell.novel[:, :0]) for cell in first if cell.size == first[0].size]
    how = learning(given, family, **trained.model_dump())
    learned = run(learn_joint, [LearningTask(cell, how) for cell in cells], compute, f"families, {family}")
    judged = [
        FamilyTask(cell, Vectors(how.family, one.entity, one.relation))
        for cell, one in zip(cells, learned, strict=True)
    ]
    measured = run(measure, judged, compute, f"families, {family}, measured")
    table = pd.concat(rows(frame, one) for frame, one in zip(measured, learned, strict=True))
    tables.write(paths.families(experiment, family), table, tables.FAMILIES, given.provenance)


if __name__ == "__main__":
    compare_families()
