"""Mine a source into observations, and name its entities."""

from __future__ import annotations

import pandas as pd

from isi.errors import InputError
from isi.sources import observing
from isi.sources.tables import KINDS, MINED, OBSERVATIONS
from isi.stage import StageContext, stage


@stage
def mine(given: StageContext, source: str) -> None:
    """Mine a source into observations, and name its entities."""
    key = f"sources.{source}"
    observed, parts = observing(given.raw(key), key, given.seed)
    try:
        rows = OBSERVATIONS.write_stream(parts, given.stage, source=source)
    except InputError as error:
        raise InputError(key, "", str(error)) from error
    left = pd.DataFrame(observed.mining.left.items(), columns=list(MINED.columns))
    KINDS.write(observed.kinds, given.stage, source=source)
    MINED.write(left, given.stage, source=source)
    print(f"{rows:,} rows of observations of {len(observed.kinds)} entities")
    for step, instances in observed.mining.left.items():
        print(f"  {instances:,} {step}")


if __name__ == "__main__":
    mine()
