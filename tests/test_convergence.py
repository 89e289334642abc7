"""The epoch at which fine-tuning counts as converged, against values by hand for a few runs."""

import numpy as np
import pandas as pd
import pytest

from isi.evaluation.query_sets import epochs_to_convergence

Row = tuple[str, str, int, int, int, float]


def converged(rows: list[Row], by: list[str]) -> pd.DataFrame:
    """Epochs to convergence of runs (model, scope, size, seed, epoch, MRR*),
    with 4 queries if MRR* is not null.
    """
    runs = pd.DataFrame(rows, columns=["model", "scope", "size", "seed", "epoch", "mrr_star"])
    runs = runs.assign(queries=runs["mrr_star"].notna() * 4)
    of_joint = runs["model"] == "joint"
    return epochs_to_convergence(runs[~of_joint], runs[of_joint], 0.08, 150, by)


@pytest.mark.parametrize(
    ("mrr_star", "epochs", "within"),
    [([0.1, 0.42, 0.3, 0.5], 1, True), ([0.6, 0.1], 0, True), ([0.1, 0.2], 150, False)],
)
def test_it_is_the_first_epoch_within_the_margin(
    mrr_star: list[float], epochs: int, within: bool
) -> None:
    tried: list[Row] = [("es", "all", 1, 0, epoch, value) for epoch, value in enumerate(mrr_star)]
    (row,) = converged([("joint", "all", 1, 0, 0, 0.49), *tried], ["model"]).to_dict("records")
    assert (row["epochs"], row["converged"], row["queries"]) == (epochs, within, 4)


def test_it_is_measured_by_the_joint_model_of_the_same_scope_size_and_seed() -> None:
    joint: list[Row] = [
        ("joint", scope, size, seed, 0, value)
        for scope, size, seed, value in (
            ("all", 1, 0, 0.7),
            ("all", 1, 1, 0.9),
            ("all", 2, 0, 0.9),
            ("novel_heldout", 1, 0, 0.9),
        )
    ]
    points = [row[1:4] for row in joint]
    tried: list[Row] = [
        ("es", *point, epoch, value) for point in points for epoch, value in ((0, 0.6), (1, 0.65))
    ]
    epochs = converged([*joint, *tried], ["model"]).set_index(["scope", "size", "seed"])["epochs"]
    assert epochs.to_dict() == {point: 1 if point == ("all", 1, 0) else 150 for point in points}


def test_runs_are_grouped_by_the_given_columns_in_the_scopes_of_convergence() -> None:
    tried: list[Row] = [("es", "all", 1, 0, 2, 0.7), ("rs", "all", 1, 0, 5, 0.7)]
    rows: list[Row] = [("joint", "all", 1, 0, 0, 0.7), *tried]
    assert converged(rows, ["model"]).set_index("model")["epochs"].to_dict() == {"es": 2, "rs": 5}
    rows = [
        (model, scope, 1, 0, 0, 0.5)
        for model in ("joint", "es")
        for scope in ("all", "known", "novel")
    ]
    assert converged(rows, ["model"])["scope"].tolist() == ["all"]


def test_cells_without_queries_take_no_part() -> None:
    scope = "novel_heldout"
    rows: list[Row] = [
        (model, scope, 1, seed, 0, value)
        for model in ("joint", "es")
        for seed, value in ((0, np.nan), (1, 0.5))
    ]
    assert converged(rows, ["model"])["seed"].tolist() == [1]
