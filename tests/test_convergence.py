"""The epoch at which fine-tuning counts as converged, against values by hand for a few runs."""

import numpy as np
import pandas as pd
import pytest

from isi.evaluation.query_sets import epochs_to_convergence

Row = tuple[str, str, int, int, int, float]


def converged(rows: list[Row]) -> dict[tuple[str, int, int], tuple[int, bool]]:
    """Epochs to convergence, and whether it has, by model, size and seed; rows: model, scope, size,
    seed, epoch, MRR.
    """
    runs = pd.DataFrame(rows, columns=["model", "scope", "size", "seed", "epoch", "mrr"])
    of_joint = runs["model"] == "joint"
    found = epochs_to_convergence(runs[~of_joint], runs[of_joint], 0.08, 150, ["model"])
    keys = zip(found["model"], found["size"], found["seed"], strict=True)
    return dict(zip(keys, zip(found["epochs"], found["converged"], strict=True), strict=True))


def run_of(known: list[float], novel: list[float], size: int = 1, seed: int = 0) -> list[Row]:
    """A run of ES beside a joint model of 0.5 in both groups; NaN: without queries."""
    rows = list[Row]()
    for group, values in (("known", known), ("novel", novel)):
        rows.append(("joint", group, size, seed, 0, np.nan if np.isnan(values[0]) else 0.5))
        rows += [("es", group, size, seed, epoch, value) for epoch, value in enumerate(values)]
    return [*rows, ("joint", "held_out", size, seed, 0, 0.9), ("es", "held_out", size, seed, 0, 0)]


@pytest.mark.parametrize(
    ("known", "novel", "epochs", "within"),
    [
        ([0.1, 0.42, 0.3, 0.5], [0.1, 0.43, 0.5, 0.5], 1, True),
        ([0.6, 0.1], [0.45, 0.1], 0, True),  # right after insertion
        ([0.42, 0.3, 0.42], [0.3, 0.42, 0.42], 2, True),  # each before, but not at one epoch
        ([0.42, 0.3], [0.3, 0.42], 150, False),
        ([np.nan] * 3, [0.1, 0.2, 0.6], 2, True),  # a group without queries decides nothing
    ],
)
def test_it_is_the_first_epoch_at_which_both_groups_are_within_the_margin(
    known: list[float], novel: list[float], epochs: int, within: bool
) -> None:
    assert converged(run_of(known, novel)) == {("es", 1, 0): (epochs, within)}


def test_it_is_measured_by_the_joint_model_of_the_same_size_and_seed() -> None:
    values = [0.1, 0.45], [0.5, 0.5]
    rows = [*run_of(*values), *run_of(*values, size=2), *run_of(*values, seed=1)]
    changed = [
        ("joint", "known", 2, 0, 0, 0.6) if row[:4] == ("joint", "known", 2, 0) else row
        for row in rows
    ]
    assert converged(changed) == {
        ("es", 1, 0): (1, True),
        ("es", 2, 0): (150, False),
        ("es", 1, 1): (1, True),
    }


def test_a_run_without_queries_in_both_groups_takes_no_part() -> None:
    rows = [*run_of([np.nan], [np.nan]), *run_of([0.5], [0.5], seed=1)]
    assert converged(rows) == {("es", 1, 1): (0, True)}
