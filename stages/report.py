"""Render the report: tables, figures, metrics and the HTML page."""

from isi.report import data
from isi.report.page import Page
from isi.report.sections.run import what_was_run
from isi.stage import StageContext, stage
from isi.tables import paths


@stage
def report(context: StageContext) -> None:
    Page.of("report").write(paths.REPORTS, data.read(context.params, what_was_run(context.params)))
    print(f"report: {paths.REPORTS / 'index.html'}")


if __name__ == "__main__":
    report()
