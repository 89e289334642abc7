"""Keep an embedding of all of an experiment's graph, which commands of ``isi`` insert into."""

from __future__ import annotations

from isi.analyses.final_model import final_task, train_final, usual_epochs
from isi.bundle.folder import write
from isi.bundle.manifest import MODEL, Bundle, Manifest, WordSource
from isi.experiment.runner import compute_of, run
from isi.experiment.store import Store
from isi.experiment.tables import TRAINING_LOG
from isi.experiment.train import train_config
from isi.graph.words import Words
from isi.stage import COMPUTE, StageContext, stage
from isi.tables import paths
from isi.tables.table import as_text


@stage
def keep(given: StageContext, experiment: str) -> None:
    """Keep an embedding of all of an experiment's graph, which commands of ``isi`` insert into.

    Trained as joint models are, for as many epochs as they usually took.
    """
    store, how = Store(experiment), train_config(given)
    entities, graph = as_text(store.entities()), store.graph()
    log = TRAINING_LOG.read(experiment=experiment, model="joint")
    task = final_task(experiment, graph, how, usual_epochs(log))
    (learned,) = run(train_final, [task], compute_of(given), f"{experiment}, kept")
    vectors, words = store.words(), given.section("words", Words)
    source = WordSource(
        source=words.source, text=words.text, model=MODEL if words.shipped and words.text != "glove" else None
    )
    settings = {key: value for key, value in given.values.items() if key != COMPUTE}
    family = settings["embedding"]["family"]
    about = Manifest(
        family=family, family_options=settings[f"families.{family}"], words=source, inserted=[],
        made={"experiment": experiment, "epochs": task.epochs, "params": settings},
    )  # fmt: skip
    kept = Bundle(
        about, learned.entity[0], learned.relation[0], graph.entities, list(entities["kind"]), list(entities["phrase"]),
        graph.relations, graph.triples.numpy(), vectors,
    )  # fmt: skip
    write(paths.kept(experiment), kept)


if __name__ == "__main__":
    keep()
