"""Draw the page of the third pipeline, and its figures, from its tables."""

from isi.report import page
from isi.stage import stage
from isi.tables import paths


@stage
def report_continual() -> None:
    print(f"report: {page.write('continual', paths.REPORTS)}")


if __name__ == "__main__":
    report_continual()
