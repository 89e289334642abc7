"""Render the page of the paper's numbers under every reading of its metric:
tables, figures and the HTML page.
"""

from isi.report import paper_values
from isi.report.data import Results
from isi.report.page import Page
from isi.report.readings import read
from isi.report.sections.run import what_was_run
from isi.stage import StageContext, stage
from isi.tables import paths


@stage
def report_readings(context: StageContext) -> None:
    params, cases = context.params, read(context.beyond.readings)
    run, paper = what_was_run(params), paper_values.read(paths.PAPER)
    results = Results(params, run, paper, readings=cases)
    Page.of("readings").write(paths.REPORTS / "readings", results)
    print(f"report: {paths.REPORTS / 'readings' / 'index.html'}")


if __name__ == "__main__":
    report_readings()
