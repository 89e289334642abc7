"""Write the tables of the first pipeline, its plots and its headline numbers."""

from isi.report.tables import headlines
from isi.report.tables.data import Results
from isi.stage import StageContext, stage
from isi.tables import paths


@stage
def tables(context: StageContext) -> None:
    headlines.write(Results.read(context.params), paths.REPORTS)
    print(f"tables: {paths.REPORTS / 'tables'}")


if __name__ == "__main__":
    tables()
