"""The plain files of a bundle are read as they were written; and the pipeline's final model."""

from dataclasses import fields, replace

import numpy as np
import pandas as pd
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from isi.errors import InputError
from isi.formats.plain import read
from isi.home.bundle import Bundle
from isi.models.stack import uniform
from isi.training.batches import training_data
from isi.training.trainer import run_epoch, start
from stages.train_final import train_stack_for, usual_epochs, whole_graph
from tests.small_bundle import NAMES, files, small, written
from tests.small_graphs import random_graph
from tests.small_grid import LEARNING

CELL = st.text(st.characters(exclude_categories=["Cc", "Cs", "Zl", "Zp"]), max_size=20)


@given(
    names=st.lists(CELL.filter(str.strip), min_size=len(NAMES), max_size=len(NAMES), unique=True),
    cells=st.lists(CELL, min_size=2 * len(NAMES), max_size=2 * len(NAMES)),
    dtype=st.sampled_from([np.float32, np.float64]),
    words=st.booleans(),
)
def test_what_is_written_is_read_again(
    tmp_path_factory: pytest.TempPathFactory,
    names: list[str],
    cells: list[str],
    dtype: type,
    words: bool,
) -> None:
    kinds, phrases = cells[: len(NAMES)], cells[len(NAMES) :]
    bundle = small(entity_names=names, kinds=kinds, phrases=phrases)
    bundle = replace(bundle, entities=bundle.entities.astype(dtype))
    bundle = bundle if words else replace(bundle, words=None)
    folder = written(tmp_path_factory.mktemp("bundles") / "one", bundle)
    again = read(folder)
    for field in fields(Bundle):
        ours, theirs = (getattr(each, field.name) for each in (bundle, again))
        assert np.array_equal(ours, theirs)
        assert getattr(ours, "dtype", None) == getattr(theirs, "dtype", None)
    assert files(folder) == files(written(folder, again))


# The final model of the pipeline


def test_the_usual_epochs_are_the_lower_median_of_the_last_that_were_kept() -> None:
    rows = [
        (0, 5, True),
        (0, 10, True),
        (0, 15, False),
        (1, 5, True),
        (2, 20, True),
        (2, 25, False),
        (3, 15, True),
    ]
    log = pd.DataFrame(rows, columns=["seed", "epoch", "kept"])
    assert usual_epochs(log) == 10  # of 5, 10, 15, 20
    with pytest.raises(
        InputError, match="column 'kept': expected true in at least one row, a best epoch"
    ):
        usual_epochs(log.assign(kept=False))


def test_all_triples_are_learned_in_as_many_epochs() -> None:
    graph, config = random_graph(12, 2, 40), LEARNING
    points = whole_graph("home", graph)
    learned, again = (train_stack_for(points, config, 3) for _ in range(2))
    assert torch.equal(learned.entity, again.entity)
    session, keys = points.session(1), torch.tensor([[0, 0]])
    assert (session.splits == 0).all()
    state = start(
        uniform(
            session.entities,
            2,
            config.model,
            config.dimension,
            config.init_range,
            config.root,
            keys,
        )
    )
    data = training_data(session, "training", keys)
    assert data.counts.sum() == graph.counts.sum()
    for epoch in (1, 2, 3):
        run_epoch(state, data, config.negatives, config.training, config.root, epoch)
    assert torch.equal(learned.entity, state.embedding.entity)
    assert torch.equal(learned.relation, state.embedding.relation)
