"""Write the tables of graphs that grow."""

import pandas as pd

from isi.initializers.api import INITIALIZERS
from isi.report.tables import registry
from isi.report.tables.data import Models
from isi.report.tables.growing import read_runs
from isi.stage import StageContext, stage
from isi.tables import paths


@stage
def tables_continual(context: StageContext) -> None:
    registered = [vars(INITIALIZERS.get(name)) for name in INITIALIZERS.names()]
    models = Models.of(pd.DataFrame(registered))
    results = read_runs(context.continual, models)
    folder = paths.REPORTS / "continual" / "tables"
    registry.write("continual", results, folder)
    print(f"tables: {folder}")


if __name__ == "__main__":
    tables_continual()
