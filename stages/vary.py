"""Run experiments again under other conditions, beside their main runs."""

from __future__ import annotations

from isi.analyses.variants import VARIANT_QUERIES, VARIANT_RUNS, Variant, changed, results
from isi.experiment.store import Store
from isi.stage import StageContext, stage


@stage
def vary(given: StageContext, variant: str) -> None:
    """Run experiments again under other conditions: train if need be, insert, and fine-tune until convergence."""
    study = given.section(f"variants.{variant}", Variant)
    own = changed(given, study.changes, f"variants.{variant}.changes")
    runs, asked = results(own, study, [Store(name) for name in study.experiments], variant)
    VARIANT_RUNS.write(runs, given.stage, variant=variant)
    VARIANT_QUERIES.write(asked, given.stage, variant=variant)


if __name__ == "__main__":
    vary()
