"""Train the joint model with one embedding model, and measure it over all queries."""

import pandas as pd

from isi.analyses.model_comparison import MODEL_COMPARISON, ModelTask, measure, rows
from isi.experiment.grid import StackedVectors
from isi.experiment.runner import run, stack_height
from isi.experiment.store import Store
from isi.experiment.train import TrainTask, model_of, train_config, train_stack
from isi.stage import StageContext, stage
from isi.training.trainer import Training


@stage
def compare_models(context: StageContext, experiment: str, model: str) -> None:
    """Train the joint model with one embedding model, and measure it over all queries."""
    params, settings = context.params, context.params.compare_models
    first = Store(experiment).grid(stack_height(params.compute), seeds=settings.seeds)
    grid = [points.all_known for points in first if points.size == first[0].size]
    shared = {
        name: getattr(params.training, name) for name in ("batch_size", "max_epochs", "evaluate_every", "patience")
    }
    training = Training(**shared, **settings.models[model].model_dump())
    config = train_config(params, model_of(params, model), training)
    trained = run(train_stack, [TrainTask(points, config) for points in grid], params.compute, f"models, {model}")
    tasks = [
        ModelTask(points, StackedVectors(config.model, result.entity, result.relation))
        for points, result in zip(grid, trained, strict=True)
    ]
    measured = run(measure, tasks, params.compute, f"models, {model}, measured")
    table = pd.concat(rows(frame, result) for frame, result in zip(measured, trained, strict=True))
    MODEL_COMPARISON.write(table, context.stage, experiment=experiment, model=model)


if __name__ == "__main__":
    compare_models()
