"""Keep an embedding of all of an experiment's graph, which commands of ``isi`` insert into."""

from __future__ import annotations

from isi.base import paths, tables
from isi.base.stage import COMPUTE, Given, stage
from isi.experiments.executor import compute_of, run
from isi.experiments.learning import learning
from isi.experiments.store import Store
from isi.keeping.folder import write
from isi.keeping.kept import MODEL, About, Kept, WordSource
from isi.studies.keeping import learn_whole, usual_epochs, whole
from isi.words import Words


@stage
def keep(given: Given, experiment: str) -> None:
    """Keep an embedding of all of an experiment's graph, which commands of ``isi`` insert into.

    Trained as joint models are, for as many epochs as they usually took.
    """
    store, how = Store(experiment, given.provenance), learning(given)
    entities, graph = tables.as_text(store.entities()), store.graph()
    log = tables.read(paths.training_log(experiment, "joint"), tables.TRAINING_LOG, given.provenance)
    task = whole(experiment, graph, how, usual_epochs(log))
    (learned,) = run(learn_whole, [task], compute_of(given), f"{experiment}, kept")
    vectors, words = store.words(), given.section("words", Words)
    source = WordSource(
        source=words.source, text=words.text, model=MODEL if words.shipped and words.text != "glove" else None
    )
    settings = {key: value for key, value in given.values.items() if key != COMPUTE}
    family = settings["embedding"]["family"]
    about = About(
        family=family, family_options=settings[f"families.{family}"], words=source, inserted=[],
        made={"experiment": experiment, "epochs": task.epochs, "params": settings, **given.provenance.metadata()},
    )  # fmt: skip
    kept = Kept(
        about, learned.entity[0], learned.relation[0], graph.entities, list(entities["kind"]), list(entities["phrase"]),
        graph.relations, graph.triples.numpy(), vectors,
    )  # fmt: skip
    write(paths.kept(experiment), kept)


if __name__ == "__main__":
    keep()
