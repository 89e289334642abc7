"""Write the tables of the first pipeline, its plots and its headline numbers."""

from isi.tables import paths
from stages.report.tables import headlines
from stages.report.tables.data import Results
from stages.stage import StageContext, stage


@stage
def tables(context: StageContext) -> None:
    headlines.write(Results.read(context.params), paths.REPORTS)
    print(f"tables: {paths.REPORTS / 'tables'}")


if __name__ == "__main__":
    tables()
