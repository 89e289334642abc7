"""Render the page of the paper's numbers under every reading of its metric:
tables, figures and the HTML page.
"""

from isi.report import data
from isi.report.page import Page
from isi.report.sections.run import what_was_run
from isi.stage import StageContext, stage
from isi.tables import paths


@stage
def report_readings(context: StageContext) -> None:
    results = data.read_readings(context.params, what_was_run(context.params))
    Page.of("readings").write(paths.REPORTS / "readings", results)
    print(f"report: {paths.REPORTS / 'readings' / 'index.html'}")


if __name__ == "__main__":
    report_readings()
