"""Train the joint model with one embedding model, and measure it over all queries."""

import pandas as pd

from isi.analyses.joint_models import MODEL_COMPARISON, compare
from isi.experiment.runner import run, stack_height
from isi.experiment.store import Store
from isi.stage import StageContext, stage
from isi.training.trainer import Training


@stage
def compare_models(context: StageContext, experiment: str, model: str) -> None:
    params, settings = context.params, context.params.compare_models
    grid = Store(experiment).grid(stack_height(params.compute), seeds=settings.seeds)
    shared = {
        name: getattr(params.training, name)
        for name in ("batch_size", "max_epochs", "evaluate_every", "patience")
    }
    training = Training(**shared, **settings.models[model].model_dump())
    config = params.train_config(params.model_of(model), training)
    tasks = [(points.all_known, config) for points in grid if points.size == grid[0].size]
    measures = pd.concat(run(compare, tasks, params.compute, f"models, {model}"))
    MODEL_COMPARISON.write(measures, context.stage, experiment=experiment, model=model)


if __name__ == "__main__":
    compare_models()
