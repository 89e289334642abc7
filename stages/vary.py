"""Run experiments again under other conditions, beside their main runs."""

from __future__ import annotations

from isi.analyses.variants import Variant, changed, results
from isi.experiment.store import Store
from isi.stage import StageContext, stage
from isi.tables import catalogue, io, paths


@stage
def vary(given: StageContext, variant: str) -> None:
    """Run experiments again under other conditions: train if need be, insert, and fine-tune until convergence."""
    study = given.section(f"variants.{variant}", Variant)
    own = changed(given, study.changes, f"variants.{variant}.changes")
    runs, asked = results(own, study, [Store(name, given.provenance) for name in study.experiments], variant)
    io.write(paths.variant(variant), runs, catalogue.VARIANTS, given.provenance)
    io.write(paths.variant_asked(variant), asked, catalogue.VARIANTS_ASKED, given.provenance)


if __name__ == "__main__":
    vary()
