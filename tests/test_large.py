"""``insert_rows``: vectors of new entities from a memory-mapped table,
as ``isi.insert`` computes them.
"""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

import isi
from isi.errors import InputError
from isi.insertion.large import insert_rows
from tests.small_graphs import random_embedding

ENTITIES, RELATIONS = 60, 3


def graph() -> dict[str, Any]:
    stack, rng = random_embedding(1, ENTITIES, RELATIONS, 8), np.random.default_rng(0)
    triples = [
        [rng.integers(ENTITIES), rng.integers(RELATIONS), ENTITIES + place]
        for place, number in enumerate((2, 70, 1))
        for _ in range(number)
    ]
    known = np.stack([rng.integers(0, most, 200) for most in (ENTITIES, RELATIONS, ENTITIES)], 1)
    return {
        "entities": stack.entity[0].numpy(),
        "relations": stack.relation[0].numpy(),
        "triples": np.array(triples),
        "new": 3,
        "model": "complex",
        "known_triples": known,
    }


@pytest.mark.parametrize("name", ["fold_in", "map", "soft_rs", "mean"])
def test_rows_of_a_file_are_those_of_insert_and_the_file_is_only_read(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    given, file = graph(), tmp_path / "entities.npy"
    np.save(file, given["entities"])
    expected = isi.insert(**given, initializer=name).entities[ENTITIES:]
    before, mapped = file.read_bytes(), np.load(file, mmap_mode="r")
    tables = list[torch.Tensor]()
    convert = torch.from_numpy
    monkeypatch.setattr(
        torch, "from_numpy", lambda array: tables.append(convert(array)) or tables[-1]
    )
    rows = insert_rows(**given | {"entities": mapped}, initializer=name)
    np.testing.assert_allclose(rows, expected, rtol=1e-4, atol=1e-5)
    assert file.read_bytes() == before
    # the table is the file, not a copy
    assert mapped.ctypes.data in [given.data_ptr() for given in tables]


@pytest.mark.parametrize(
    ("changed", "named"),
    [
        ({"triples": [(ENTITIES, 0, ENTITIES + 1)]}, "triples"),
        ({"entities": np.zeros((ENTITIES, 8))}, "entities"),
        ({"initializer": "soft_hybird"}, "initializer"),
    ],
)
def test_a_wrong_argument_is_named(changed: dict[str, Any], named: str) -> None:
    with pytest.raises(InputError, match=named):
        insert_rows(**graph() | changed)
