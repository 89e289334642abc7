"""Sample splits, novel entities and insert triples for every size and seed."""

from isi.graph.graph import ENTITIES, TRIPLES, build_graph
from isi.graph.sessions import session_tables
from stages.stage import StageContext, stage


@stage
def make_sessions(context: StageContext, experiment: str) -> None:
    params, key = context.params, f"experiments.{experiment}.sessions"
    entities = ENTITIES.read(experiment=experiment)
    graph = build_graph(
        entities, TRIPLES.read(experiment=experiment), TRIPLES.path(experiment=experiment)
    )
    sessions = params.experiments[experiment].sessions
    for table, drawn in session_tables(
        graph, entities, sessions, params.sessions, params.seed, key
    ).items():
        table.write(drawn, context.stage, experiment=experiment)


if __name__ == "__main__":
    make_sessions()
