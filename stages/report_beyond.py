"""Draw the page of the second pipeline, and its figures, from its tables."""

from isi.report import page
from isi.stage import stage
from isi.tables import paths


@stage
def report_beyond() -> None:
    print(f"report: {page.write('beyond', paths.REPORTS)}")


if __name__ == "__main__":
    report_beyond()
