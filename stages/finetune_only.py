"""Fine-tune Θ⁰ on D⁰ without an insertion, and measure it after every epoch.

Sizes, seeds and epochs are those of the learning curves after insertion (``full_curves``).
"""

from isi.analyses import finetuning
from isi.analyses.finetuning import FINETUNE_ONLY
from isi.tables.table import concat
from stages.runner import run, stack_height
from stages.stage import StageContext, stage
from stages.store import Store


@stage
def finetune_only(context: StageContext, experiment: str) -> None:
    params, store = context.params.of(experiment), Store(experiment)
    model, entry = params.model_of(), params.experiments[experiment]
    tasks = [
        (points, store.theta0(points, model), params.seed, params.negatives, params.finetuning)
        for size in entry.full_curves
        for points in store.grid(stack_height(params.compute), size, entry.finetuned.seeds)
    ]
    runs = run(finetuning.finetune_only, tasks, params.compute, f"{experiment}, nothing inserted")
    FINETUNE_ONLY.write(concat(runs, FINETUNE_ONLY), context.stage, experiment=experiment)


if __name__ == "__main__":
    finetune_only()
