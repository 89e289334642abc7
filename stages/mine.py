"""Mine the observations and the entities of a source, and count what each step of mining leaves."""

from typing import Any

import pandas as pd

from isi.errors import at
from isi.sources import Source
from isi.tables import paths
from isi.tables.rules import TEXT, at_least
from isi.tables.table import Table
from stages.files import KINDS, OBSERVATIONS
from stages.stage import StageContext, stage

#: Number of instances (RDF: triples) by description, ``step``: those left after a step, dropped, or
#: irregular.
MINED = Table(
    "data/observations/{source}.mined.parquet",
    {"step": TEXT, "instances": at_least(0, "int64")},
    key=["step"],
)


@stage
def mine(context: StageContext, source: str) -> None:
    key = f"sources.{source}"
    settings, root = context.params.read(key, dict[str, Any]), context.params.seed
    with at(paths.PARAMS, key):
        mined = Source(settings, key, root)
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
