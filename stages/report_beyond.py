"""Draw the page of the second pipeline, and its figures, from its tables."""

from isi.tables import paths
from stages.report import page
from stages.stage import stage


@stage
def report_beyond() -> None:
    print(f"report: {page.write('beyond', paths.REPORTS)}")


if __name__ == "__main__":
    report_beyond()
