"""Mine the observations and the entities of a source, and count what each step of mining leaves."""

import pandas as pd

from isi.errors import at
from isi.sources import KINDS, MINED, OBSERVATIONS, Source
from isi.tables import paths
from stages.stage import StageContext, stage


@stage
def mine(context: StageContext, source: str) -> None:
    key = f"sources.{source}"
    with at(paths.PARAMS, key):
        mined = Source(context.params.sources[source], key, context.params.seed)
        rows = OBSERVATIONS.write_parts(
            OBSERVATIONS.path(source=source), mined.frames(), context.stage
        )
    counts = pd.DataFrame(mined.counts.items(), columns=list(MINED.columns))
    KINDS.write(mined.kinds, context.stage, source=source)
    MINED.write(counts, context.stage, source=source)
    print(f"{rows:,} rows of observations of {len(mined.kinds)} entities")
    for step, instances in mined.counts.items():
        print(f"  {instances:,} {step}")


if __name__ == "__main__":
    mine()
