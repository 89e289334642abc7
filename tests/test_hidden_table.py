"""The table of hidden entities: means over seeds, and who is said to be first, by hand."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pandas as pd
import pytest
import yaml

from isi.analyses.hidden_entities import HIDDEN_ENTITIES, seconds_path
from isi.tables import paths
from tests.hidden_ring import ENTRY
from tools import hidden

#: Method, told, and mean reciprocal ranks of known ends by two seeds.
FOUND = [
    ("insert", 1, (0.5, 0.7)), ("mean", 1, (0.3, 0.3)), ("own_all_rows", 1, (0.2, 0.2)),
    ("insert", None, (0.6, 0.6)), ("mean", None, (0.7, 0.7)), ("own_all_rows", None, (0.8, 1.0)),
    ("retrained", None, (0.4, 0.4)),
]  # fmt: skip
INITIALIZERS = {"insert": "map_mean", "mean": "mean"}


@pytest.fixture
def written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(hidden, "TABLE", tmp_path / "hidden.md")
    rows = [
        {"method": method, "initializer": INITIALIZERS.get(method), "told": told, "seed": seed,
         "asked": asked, "entities": 4, "queries": 10, "mrr": mrr if asked == "known" else 0.125, "hits_at_10": 0.25}
        for method, told, both in FOUND for seed, mrr in enumerate(both) for asked in ("known", "hidden", "earlier")
    ]  # fmt: skip
    paths.BEYOND_PARAMS.parent.mkdir()
    entries = {"ring": ENTRY | {"max_insert_triples": [1, None]}, "later": ENTRY}
    shutil.copy(Path(__file__).parent.parent / paths.PARAMS, paths.PARAMS)
    paths.BEYOND_PARAMS.write_text(yaml.safe_dump({"variants": {}, "hidden": entries}), encoding="utf-8")
    HIDDEN_ENTITIES.write(pd.DataFrame(rows), "hide", graph="ring")
    took = [{"method": method, "told": told, "seconds": 12.34 if told else 0.0123} for method, told, _ in FOUND]
    seconds_path("ring").write_text(json.dumps(took), encoding="utf-8")
    return tmp_path / "hidden.md"


def test_means_stand_in_the_table_and_who_is_first_beneath(written: Path) -> None:
    hidden.main()
    head, _, *lines = written.read_text(encoding="utf-8").splitlines()
    cells = [[cell.strip() for cell in line.split("|")[1:-1]] for line in (head, *lines) if line.startswith("|")]
    columns = ["known ends, 1", "known ends, all", "hidden ones, 1", "hidden ones, all"]
    same = ["0.125", "0.125", "0.250", "0.125", "0.012"]
    assert cells == [
        ["graph", "", *columns, "Hits@10", "earlier", "s"],
        ["Ring", "`isi.pykeen.insert`: `map_mean`, its default", "0.600", "0.600", *same],
        ["", "`isi.pykeen.insert`: `mean`", "0.300", "0.700", *same],
        ["", "PyKEEN's own, then 3 epochs of all rows", "0.200", "0.900", *same],
        ["", "all trained again", "", "0.400", "", *same[1:]],
    ]  # fmt: skip
    assert lines[-1] == (
        "- **Ring** (2 times 4 hidden). Told 1, first is `isi.pykeen.insert`: `map_mean`, its default (0.600). "
        "Told all, first is PyKEEN's own, then 3 epochs of all rows (0.900), and of those that train nothing "
        "`isi.pykeen.insert`: `mean` (0.700); the default stands at place 3 of 4 (0.600). "
        "Earlier triples have 0.125 with the default, and 0.125 where all is trained again."
    )


def test_where_nothing_was_hidden_nothing_is_written(written: Path) -> None:
    HIDDEN_ENTITIES.path(graph="ring").unlink()
    hidden.main()
    assert not written.exists()
