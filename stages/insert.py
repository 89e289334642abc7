"""Insert novel entities into Θ⁰ with one initializer, measure at once, and fine-tune."""

from __future__ import annotations

from isi.experiments.store import Store
from isi.experiments.tasks import insert_all
from isi.stage import Params, Provenance, stage


@stage(
    "seed", "negatives.mode", "negatives.ratio", "negatives.head_pool", "finetuning.batch_size",
    "finetuning.learning_rate", "finetuning.weight_decay", "finetuning.max_epochs", "convergence.margin",
    "curves.sizes", "initializers.{initializer}", argument="initializer",
)  # fmt: skip
def insert(params: Params, provenance: Provenance, initializer: str) -> None:
    """Insert novel entities into Θ⁰ with one initializer, measure at once, and fine-tune."""
    insert_all(Store("ai2thor", provenance), params, initializer, params.curves.sizes)


if __name__ == "__main__":
    insert()
