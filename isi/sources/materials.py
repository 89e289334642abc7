"""Materials of object instances: drawn as in SUNCG (section 5.1), or as the simulator reports them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import compress
from pathlib import Path
from typing import Literal

import numpy as np
import pandas as pd

from isi.errors import InputError, short
from isi.random import stream
from isi.sources.names import entity_name
from isi.sources.readers import read_table
from isi.sources.recordings import SceneObject
from isi.tables import paths

#: Setting: whose materials.
Materials = Literal["suncg", "simulator"]
#: Gives the materials of each object of a scene, from the scene's number and its objects.
MaterialsOf = Callable[[int, Sequence[SceneObject]], list[list[str]]]


def materials_of(materials: Materials, seed: int) -> MaterialsOf:
    """The materials of objects: drawn from a seed, or as the simulator reports them."""
    if materials == "simulator":
        return reported_materials
    return suncg_materials(read_shares(paths.MATERIAL_SHARES, paths.MATERIAL_CATEGORIES), seed)


def reported_materials(_scene: int, objects: Sequence[SceneObject]) -> list[list[str]]:
    """The ``salientMaterials`` that the simulator reports, in lower case, each once."""
    return [list(dict.fromkeys(map(str.lower, thing.get("salientMaterials") or ()))) for thing in objects]


def suncg_materials(shares: pd.DataFrame, root: int) -> MaterialsOf:
    """Draw each material of each instance with the share of its category; none without a category.

    There is one stream per scene: a scene's draws depend on its number and its objects alone.
    """
    row_of = {name: row for row, name in enumerate(shares.index)}
    table = np.vstack([shares.to_numpy(dtype=float), np.zeros(shares.shape[1])])

    def draw(scene: int, objects: Sequence[SceneObject]) -> list[list[str]]:
        rows = [row_of.get(entity_name(thing["objectType"]), -1) for thing in objects]
        drawn = stream(root, "materials", scene).random((len(rows), shares.shape[1])) < table[rows]
        return [list(compress(shares.columns, has_material)) for has_material in drawn.tolist()]

    return draw


def read_shares(shares: Path, categories: Path) -> pd.DataFrame:
    """Share of instances with each material: one row per object name, one column per material.

    Args:
        shares: CSV of ``concept,material,share`` (SUNCG categories).
        categories: CSV of ``object,category``, which maps object names to those categories.

    Raises:
        InputError: where a file is missing or broken, or maps to a category without shares.
    """
    listed = read_table(shares, ["concept", "material", "share"], ["concept", "material"])
    wrong = listed.loc[~pd.to_numeric(listed["share"], errors="coerce").between(0, 1), "share"]
    if len(wrong):
        expected = f"expected a number from 0 to 1 as share, got {short(wrong.iloc[0])}"
        raise InputError(shares, f"line {wrong.index[0]}", expected)
    listed["share"] = listed["share"].map(float)
    table = listed.pivot(index="concept", columns="material", values="share")
    mapping = read_table(categories, ["object", "category"], ["object"])
    unknown = mapping.loc[~mapping["category"].isin(table.index), "category"]
    if len(unknown):
        raise InputError(categories, f"line {unknown.index[0]}", f"no shares for category {short(unknown.iloc[0])}")
    return table.loc[mapping["category"]].set_axis(pd.Index(mapping["object"]), axis=0).fillna(0.0)
