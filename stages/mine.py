"""Mine a source into observations, and name its entities."""

from __future__ import annotations

import pandas as pd

from isi.base import paths, tables
from isi.base.errors import InputError
from isi.base.stage import Given, stage
from isi.sources import observing


@stage
def mine(given: Given, source: str) -> None:
    """Mine a source into observations, and name its entities."""
    key, provenance = f"sources.{source}", given.provenance
    observed, parts = observing(given.raw(key), key, given.seed)
    try:
        rows = tables.write_stream(paths.observations(source), parts, tables.OBSERVATIONS, provenance)
    except InputError as error:
        raise InputError(key, "", str(error)) from error
    left = pd.DataFrame(observed.mining.left.items(), columns=tables.MINED.names)
    tables.write(paths.kinds(source), observed.kinds, tables.KINDS, provenance)
    tables.write(paths.mined(source), left, tables.MINED, provenance)
    print(f"{rows:,} rows of observations of {len(observed.kinds)} entities")
    for step, instances in observed.mining.left.items():
        print(f"  {instances:,} {step}")


if __name__ == "__main__":
    mine()
