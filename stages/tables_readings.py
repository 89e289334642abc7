"""Write the tables of the paper's numbers under every reading of its metric."""

import pandas as pd

from isi.initializers.api import INITIALIZERS
from isi.report.tables import registry
from isi.report.tables.data import Models
from isi.report.tables.readings import Readings
from isi.stage import StageContext, stage
from isi.tables import paths


@stage
def tables_readings(context: StageContext) -> None:
    registered = [vars(INITIALIZERS.get(name)) for name in INITIALIZERS.names()]
    models = Models.of(pd.DataFrame(registered))
    results = Readings.read(context.params, context.beyond.readings, models)
    folder = paths.REPORTS / "readings" / "tables"
    registry.write("readings", results, folder)
    print(f"tables: {folder}")


if __name__ == "__main__":
    tables_readings()
