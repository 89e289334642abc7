"""Run a variant of experiments: train if its changes require it, insert,
fine-tune unless ``finetuned`` is false.
"""

from isi.analyses.variants import VARIANT_QUERIES, VARIANT_RUNS, changed, results
from isi.experiment.store import Store
from isi.stage import StageContext, stage


@stage
def vary(context: StageContext, variant: str) -> None:
    settings = context.beyond.variants[variant]
    params = changed(context.params, settings.changes)
    stores = [Store(name) for name in settings.experiments]
    runs, answers = results(settings, params.variant_config(settings), stores, variant)
    VARIANT_RUNS.write(runs, context.stage, variant=variant)
    VARIANT_QUERIES.write(answers, context.stage, variant=variant)


if __name__ == "__main__":
    vary()
