"""Mine a source into observations, and name its entities."""

import pandas as pd

from isi.errors import at
from isi.sources import observing
from isi.sources.tables import KINDS, MINED, OBSERVATIONS
from isi.stage import StageContext, stage
from isi.tables import paths


@stage
def mine(context: StageContext, source: str) -> None:
    """Mine a source into observations, and name its entities."""
    key = f"sources.{source}"
    with at(paths.PARAMS, key):
        observed, parts = observing(context.params.sources[source], key, context.params.seed)
        rows = OBSERVATIONS.write_stream(parts, context.stage, source=source)
    steps = pd.DataFrame(observed.mining.left.items(), columns=list(MINED.columns))
    KINDS.write(observed.kinds, context.stage, source=source)
    MINED.write(steps, context.stage, source=source)
    print(f"{rows:,} rows of observations of {len(observed.kinds)} entities")
    for step, instances in observed.mining.left.items():
        print(f"  {instances:,} {step}")


if __name__ == "__main__":
    mine()
