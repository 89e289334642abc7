"""Tables of speed: which rows are compared, and which run wrote a table."""

import pandas as pd

from tools.benchmarks import NONE, training
from tools.docs import recorded

ROWS = pd.DataFrame(
    [
        ("isi", "ComplEx", "complex", "27 sampled", 1, 28e6, 2.0),
        ("isi", "ComplEx", "complex", "27 sampled", 5, 140e6, 5.0),
        ("isi", "ComplEx", "complex", "27 expected", 1, None, 0.5),
        ("isi", "TransE", "transe", "27 expected", 1, None, 0.5),
        ("PyKEEN", "ComplEx", "complex", "27 sampled", 1, 28e6, 8.0),
        ("PyKEEN", "ComplEx", "complex", "9 sampled", 1, 10e6, 4.0),
    ],
    columns=["library", "model", "family", "negatives", "models", "scored", "median"],
)


def test_only_like_trainings_are_compared() -> None:
    table = pd.DataFrame(training(ROWS))
    assert table["times as fast as PyKEEN"].tolist() == ["4.00", NONE, NONE, NONE, "1.00", "1.00"]
    assert set(table["times as fast as TorchKGE"]) == {NONE}
    own = table["times as fast as one model, sampled"].tolist()
    assert own == ["1.00", "2.00", "4.00", NONE, NONE, NONE]


def test_expected_negatives_are_not_scored_one_by_one() -> None:
    scored = pd.DataFrame(training(ROWS))["million triples scored per second"].tolist()
    assert scored == ["14.0", "28.0", NONE, NONE, "3.50", "2.50"]


def test_a_table_that_a_run_did_not_measure_keeps_its_row() -> None:
    before = pd.DataFrame({"table": ["growth", "insert"], "commit": ["old", "old"]})
    after = recorded({"commit": "new"}, ["insert", "live"], before)
    assert after.to_numpy().tolist() == [["growth", "old"], ["insert", "new"], ["live", "new"]]
