"""Run a variant of experiments: train if its changes require it, insert,
fine-tune unless ``finetuned`` is false.
"""

from isi.analyses.variants import (
    VARIANT_QUERIES,
    VARIANT_RUNS,
    VariantConfig,
    changed,
    results,
)
from stages.stage import StageContext, stage
from stages.store import Store


@stage
def vary(context: StageContext, variant: str) -> None:
    settings = context.beyond.variants[variant]
    parts = list[tuple[Store, VariantConfig]]()
    for name in settings.experiments:
        params = changed(context.params.of(name), settings.changes)
        parts.append((Store(name), params.variant_config(settings)))
    runs, answers = results(settings, parts, variant)
    VARIANT_RUNS.write(runs, context.stage, variant=variant)
    VARIANT_QUERIES.write(answers, context.stage, variant=variant)


if __name__ == "__main__":
    vary()
