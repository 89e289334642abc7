"""Write the tables of the second pipeline: variants, and other graphs."""

import pandas as pd

from isi.initializers.api import INITIALIZERS
from isi.tables import paths
from stages.report.tables import registry
from stages.report.tables.data import Models
from stages.report.tables.further import Further
from stages.stage import StageContext, stage


@stage
def tables_beyond(context: StageContext) -> None:
    registered = [vars(INITIALIZERS.get(name)) for name in INITIALIZERS.names()]
    models = Models.of(pd.DataFrame(registered))
    results = Further.read(context.params, context.beyond, models)
    folder = paths.REPORTS / "beyond" / "tables"
    registry.write("beyond", results, folder)
    print(f"tables: {folder}")


if __name__ == "__main__":
    tables_beyond()
