"""Carry embeddings along a graph that grows, by all chains of an experiment: R[i, j], what each
snapshot took, and what the faults of published protocols touch.
"""

from isi import pipeline
from isi.continual.along import Along
from isi.continual.experiment import COSTS, FAULTS, FIRST, MATRIX
from isi.continual.faults import fault_shares
from isi.continual.parts import Parts, digest_of_code
from isi.continual.run import run_chains
from isi.errors import at
from isi.graph.words import load_vectors, look_up
from isi.stage import StageContext, stage
from isi.tables import paths


@stage
def grow(context: StageContext, experiment: str) -> None:
    settings, params = context.continual[experiment], context.params
    with at(paths.CONTINUAL_PARAMS, f"continual.{experiment}.timeline"):
        timeline = settings.read_timeline()
    words = None
    if settings.words is not None:
        words = look_up(load_vectors(settings.words), timeline.words).vectors
    _, entry = pipeline.find("grow")
    code = [path for path in entry["deps"] if not path.startswith("data/")]
    folder = MATRIX.path(experiment=experiment).with_name("parts")
    parts = Parts(folder, settings, timeline, words, digest_of_code(code, params.seed))
    along = Along(timeline, settings.training.schedule, words, settings.most_tests)
    compute = params.compute.model_copy(update={"device": "cpu"})
    run_chains(experiment, settings, along, parts, params.seed, compute)
    matrix, costs = parts.tables(experiment)
    MATRIX.write(matrix, context.stage, experiment=experiment)
    COSTS.write(costs, context.stage, experiment=experiment)
    FIRST.write(parts.first(experiment), context.stage, experiment=experiment)
    FAULTS.write(fault_shares(timeline), context.stage, experiment=experiment)


if __name__ == "__main__":
    grow()
