"""Draw the page of the paper's results under every reading, and its figures, from its tables."""

from isi.report import page
from isi.stage import stage
from isi.tables import paths


@stage
def report_readings() -> None:
    print(f"report: {page.write('readings', paths.REPORTS)}")


if __name__ == "__main__":
    report_readings()
