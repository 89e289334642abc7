"""Write the tables of the second pipeline: variants, and other graphs."""

from stages import check_params
from stages.files import REPORTS
from stages.report.tables import registry
from stages.report.tables.data import ModelLabels
from stages.report.tables.further import Further
from stages.stage import stage


@stage
def tables_beyond() -> None:
    params = check_params.load()
    beyond = check_params.load_beyond(params)
    results = Further.read(params, beyond, ModelLabels.registered())
    folder = REPORTS / "beyond" / "tables"
    registry.write("beyond", results, folder)
    print(f"tables: {folder}")


if __name__ == "__main__":
    tables_beyond()
