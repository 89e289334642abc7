"""Render the page of graphs that grow: tables, figures and the HTML page."""

from isi.report.continual import read
from isi.report.data import Results
from isi.report.page import Page
from isi.stage import StageContext, stage
from isi.tables import paths


@stage
def report_continual(context: StageContext) -> None:
    results = Results(context.params, {}, {}, continual=read(context.continual))
    Page.of("continual").write(paths.REPORTS / "continual", results)
    print(f"report: {paths.REPORTS / 'continual' / 'index.html'}")


if __name__ == "__main__":
    report_continual()
