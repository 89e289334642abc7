"""Write the tables of the first pipeline, its plots and its headline numbers."""

from stages import check_params
from stages.files import REPORTS
from stages.report.tables import headlines, registry
from stages.report.tables.data import Results
from stages.stage import stage


@stage
def tables() -> None:
    results, folder = Results.read(check_params.load()), REPORTS / "tables"
    registry.write("report", results, folder)
    headlines.write(results, REPORTS)
    print(f"tables: {folder}")


if __name__ == "__main__":
    tables()
