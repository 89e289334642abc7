"""Materials of object instances: drawn as in SUNCG (section 5.1), or as the simulator reports them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from itertools import compress
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from isi.errors import InputError, short
from isi.random import stream
from isi.sources._household import entity_name
from isi.sources._rows import read_listed

#: As the simulator reports it.
Object = dict[str, Any]
#: Gives the materials of each object of a scene: from the scene's number, and its objects.
MaterialsOf = Callable[[int, Sequence[Object]], list[list[str]]]


def read_shares(shares: Path, categories: Path) -> pd.DataFrame:
    """Share of instances with each material: one row per object name, one column per material.

    Args:
        shares: CSV of ``concept,material,share`` (SUNCG categories).
        categories: CSV of ``object,category`` that maps object names to those categories.

    Raises:
        InputError: where a file is missing or broken, or maps to a category without shares.
    """
    listed = read_listed(shares, ["concept", "material", "share"], ["concept", "material"])
    table = listed.pivot(index="concept", columns="material", values="share")
    mapping = read_listed(categories, ["object", "category"], ["object"])
    unknown = mapping.loc[~mapping["category"].isin(table.index)]
    if len(unknown):
        expected = f"no shares for category {short(unknown.iloc[0]['category'])}"
        raise InputError(categories, f"line {unknown.index[0]}", expected)
    return table.loc[mapping["category"]].set_axis(pd.Index(mapping["object"]), axis=0).fillna(0.0)


def suncg(shares: pd.DataFrame, root: int) -> MaterialsOf:
    """Draw each material of each instance with the share of its category; none without a category.

    One stream per scene, so that a scene's draws depend on nothing but its number and its objects.
    """
    materials = list(shares.columns)
    rows = {name: row for row, name in enumerate(shares.index)}
    table = np.vstack([shares.to_numpy(dtype=float), np.zeros(len(materials))])
    return partial(_draw, root, materials, rows, table)


def _draw(
    root: int, materials: list[str], rows: dict[str, int], table: np.ndarray, scene: int, objects: Sequence[Object]
) -> list[list[str]]:
    row = [rows.get(entity_name(thing["objectType"]), -1) for thing in objects]
    drawn = stream(root, "materials", scene).random((len(objects), len(materials))) < table[row]
    return [list(compress(materials, has)) for has in drawn.tolist()]


def simulator(_scene: int, objects: Sequence[Object]) -> list[list[str]]:
    """The ``salientMaterials`` that the simulator reports, in lower case, each once."""
    return [list(dict.fromkeys(map(str.lower, thing.get("salientMaterials") or ()))) for thing in objects]
