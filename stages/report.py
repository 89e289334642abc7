"""Render the report: tables, figures, metrics and the page."""

from isi.report import data, page
from isi.report.sections.run import what_was_run
from isi.stage import StageContext, stage
from isi.tables import paths


@stage
def report(context: StageContext) -> None:
    page.write(paths.REPORTS, data.read(context.params, what_was_run(context.params)), page.SECTIONS)
    print(f"report: {paths.REPORTS / 'index.html'}")


if __name__ == "__main__":
    report()
