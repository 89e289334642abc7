"""Write the tables of the first pipeline, its plots and its headline numbers."""

from isi.tables import paths
from stages import check_params
from stages.report.tables import headlines, registry
from stages.report.tables.data import Results
from stages.stage import stage


@stage
def tables() -> None:
    results, folder = Results.read(check_params.load()), paths.REPORTS / "tables"
    registry.write("report", results, folder)
    headlines.write(results, paths.REPORTS)
    print(f"tables: {folder}")


if __name__ == "__main__":
    tables()
