"""Train an embedding of all triples of an experiment, which the command ``isi`` uses by default.

It is trained like a joint model, for the median of the joint models' best epochs.
"""

from isi.experiment import final_model
from isi.home.bundle import MODEL, Bundle, Manifest, WordSource, write
from isi.tables import paths
from isi.tables.table import as_text
from stages.grid import JOINT_MODEL
from stages.runner import run
from stages.stage import StageContext, stage
from stages.store import TRAINING_LOG, Store


@stage
def train_final(context: StageContext, experiment: str) -> None:
    params, store = context.params.of(experiment), Store(experiment)
    entities, graph, words = as_text(store.entities()), store.graph(), params.words
    epochs = final_model.usual_epochs(TRAINING_LOG.read(experiment=experiment, model=JOINT_MODEL))
    tasks = [(final_model.whole_graph(experiment, graph), params.train_config(), epochs)]
    (trained,) = run(final_model.train_final, tasks, params.compute, f"{experiment}, final model")
    of_package = MODEL if words.shipped and words.text != "glove" else None
    model, options = params.embedding.model, params.models[params.embedding.model]
    settings = params.model_dump(
        include={"words", "embedding", "negatives", "training"}, exclude_unset=True
    )
    made = {
        "experiment": experiment,
        "epochs": epochs,
        "params": {"seed": params.seed, f"models.{model}": options, **settings},
    }
    source = WordSource(source=words.source, text=words.text, model=of_package)
    manifest = Manifest(model_name=model, model_options=options, words=source, made=made)
    bundle = Bundle(
        manifest,
        trained.entity[0].numpy(),
        trained.relation[0].numpy(),
        graph.entities,
        list(entities["kind"]),
        list(entities["phrase"]),
        graph.relations,
        graph.triples.numpy(),
        store.words(),
    )
    write(paths.final_model(experiment), bundle)


if __name__ == "__main__":
    train_final()
