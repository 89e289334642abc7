"""Render the page of the second pipeline: tables, figures and the HTML page."""

from isi.report import data
from isi.report.page import Page
from isi.report.sections.run import what_was_run
from isi.stage import StageContext, stage
from isi.tables import paths


@stage
def report_beyond(context: StageContext) -> None:
    results = data.with_beyond(data.read(context.params, what_was_run(context.params)))
    Page.of("beyond").write(paths.REPORTS / "beyond", results)
    print(f"report: {paths.REPORTS / 'beyond' / 'index.html'}")


if __name__ == "__main__":
    report_beyond()
