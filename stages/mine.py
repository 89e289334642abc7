"""Mine a source into observations, and name its entities."""

from __future__ import annotations

import pandas as pd

from isi.errors import InputError
from isi.sources import observing
from isi.stage import StageContext, stage
from isi.tables import catalogue, io, paths


@stage
def mine(given: StageContext, source: str) -> None:
    """Mine a source into observations, and name its entities."""
    key, provenance = f"sources.{source}", given.provenance
    observed, parts = observing(given.raw(key), key, given.seed)
    try:
        rows = io.write_stream(paths.observations(source), parts, catalogue.OBSERVATIONS, provenance)
    except InputError as error:
        raise InputError(key, "", str(error)) from error
    left = pd.DataFrame(observed.mining.left.items(), columns=catalogue.MINED.names)
    io.write(paths.kinds(source), observed.kinds, catalogue.KINDS, provenance)
    io.write(paths.mined(source), left, catalogue.MINED, provenance)
    print(f"{rows:,} rows of observations of {len(observed.kinds)} entities")
    for step, instances in observed.mining.left.items():
        print(f"  {instances:,} {step}")


if __name__ == "__main__":
    mine()
