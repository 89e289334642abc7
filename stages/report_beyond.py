"""Draw the page of the second pipeline, and its figures, from its tables."""

from stages.files import REPORTS
from stages.report import page
from stages.stage import stage


@stage
def report_beyond() -> None:
    print(f"report: {page.write('beyond', REPORTS)}")


if __name__ == "__main__":
    report_beyond()
