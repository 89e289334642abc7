"""Draw the page of the first pipeline, and its figures, from its tables."""

from isi.tables import paths
from stages.files import REPORTS
from stages.report import page
from stages.stage import stage


@stage
def report() -> None:
    shown = sorted((paths.DATA / "analyses" / "demonstration").glob("*.json"))
    print(f"report: {page.write('report', REPORTS, shown[0] if shown else None)}")


if __name__ == "__main__":
    report()
