"""Draw the page of the first pipeline, and its figures, from its tables."""

from isi.report import page
from isi.stage import stage
from isi.tables import paths


@stage
def report() -> None:
    shown = sorted((paths.DATA / "analyses" / "demonstration").glob("*.json"))
    print(f"report: {page.write('report', paths.REPORTS, shown[0] if shown else None)}")


if __name__ == "__main__":
    report()
