"""Tasks of an experiment, made from what the pipeline keeps."""

from __future__ import annotations

from collections.abc import Sequence

from isi import convergence, paths
from isi.experiments.cells import Cells
from isi.experiments.insertion import FineTuning, InsertTask
from isi.experiments.store import Store, insert_triples_of, joint_mrr_star
from isi.params import Params


def insertion_tasks(
    store: Store, params: Params, initializer: str, cells: Sequence[Cells], to_the_end: Sequence[int] = ()
) -> list[InsertTask]:
    """Insertion with one initializer, and fine-tuning, of cells of the store's experiment.

    Args:
        to_the_end: sizes that are fine-tuned for all epochs; the others stop at convergence.
    """
    tuning = FineTuning(params.seed, params.negatives, params.finetuning, params.convergence.margin, list(to_the_end))
    insert_triples, joint = store.insert_triples(), store.runs("joint")
    (words,) = store.tensors(paths.vectors(store.experiment), "vectors")
    return [
        InsertTask(
            **vars(cell),
            embedding=store.theta0(cell),
            insert_triples=insert_triples_of(cell, insert_triples),
            initializer=initializer,
            options=params.initializers.options(initializer),
            words=words,
            joint_mrr_star={scope: joint_mrr_star(joint, cell, scope) for scope in convergence.SCOPES},
            tuning=tuning,
        )
        for cell in cells
    ]
