"""Train on a graph under the paper's conditions, insert, fine-tune,
and measure under every reading of its metric.
"""

from isi.analyses.readings import ANSWERS, RANKS, READING_CURVES, READINGS, measure
from isi.analyses.variants import changed
from isi.errors import at
from isi.experiment.store import Store
from isi.graph.graph import tables_of
from isi.stage import StageContext, stage
from isi.tables import paths
from stages.build_graph import mined


@stage
def measure_readings(context: StageContext, case: str) -> None:
    key, settings = f"readings.{case}", context.beyond.readings[case]
    params = changed(context.params, settings.changes)
    with at(paths.BEYOND_PARAMS, key):
        tables = tables_of(settings.graph, mined, f"{key}.graph", params.seed)
        store = Store.drawn(
            case, tables, params.words, settings.sessions, params.sessions, params.seed, key
        )
    measured = measure(settings, params.reading_config(settings), store)
    RANKS.write(measured.ranks, context.stage, case=case)
    READINGS.write(measured.readings, context.stage, case=case)
    ANSWERS.write(measured.answers, context.stage, case=case)
    READING_CURVES.write(measured.curves, context.stage, case=case)


if __name__ == "__main__":
    measure_readings()
