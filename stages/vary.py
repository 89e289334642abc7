"""Run experiments again under other conditions, beside their main runs."""

from __future__ import annotations

from isi.base import paths, tables
from isi.base.stage import Given, stage
from isi.experiments.store import Store
from isi.studies.variants import Variant, changed, results


@stage
def vary(given: Given, variant: str) -> None:
    """Run experiments again under other conditions: train if need be, insert, and fine-tune until convergence."""
    study = given.section(f"variants.{variant}", Variant)
    own = changed(given, study.changes, f"variants.{variant}.changes")
    runs, asked = results(own, study, [Store(name, given.provenance) for name in study.experiments], variant)
    tables.write(paths.variant(variant), runs, tables.VARIANTS, given.provenance)
    tables.write(paths.variant_asked(variant), asked, tables.VARIANTS_ASKED, given.provenance)


if __name__ == "__main__":
    vary()
