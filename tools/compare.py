"""Compare the values of two runs: every table and tensor below two folders, Parquet metadata apart.

python -m tools.compare other/data data
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np
import pandas as pd
from safetensors.numpy import load_file

FORMS = {".parquet", ".safetensors", ".csv", ".json"}


def difference(first: Path, second: Path) -> str:
    """What differs between two files, in a few words; empty where nothing does."""
    if first.suffix not in (".parquet", ".safetensors"):
        return "" if first.read_bytes() == second.read_bytes() else "bytes"
    if first.suffix == ".safetensors":
        left, right = load_file(first), load_file(second)
        same = [name for name in left.keys() & right.keys() if _bits(left[name]) == _bits(right[name])]
        names = sorted((left.keys() | right.keys()) - set(same))
        return f"tensors {', '.join(names)}" if names else ""
    left, right = (pd.read_parquet(path) for path in (first, second))
    if len(left) != len(right):
        return f"{len(left)} rows against {len(right)}"
    columns = [
        name for name in left.columns.intersection(right.columns) if not _plain(left[name]).equals(_plain(right[name]))
    ]
    lacking = sorted(set(left.columns) ^ set(right.columns))
    parts = [f"columns {', '.join(columns)}"] * bool(columns) + [f"only in one: {', '.join(lacking)}"] * bool(lacking)
    return "; ".join(parts)


def _bits(tensor: np.ndarray) -> tuple[np.dtype, bytes]:
    return tensor.dtype, tensor.tobytes()


def _plain(column: pd.Series) -> pd.Series:
    return (column.astype(str) if column.dtype == "category" else column).reset_index(drop=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("first", type=Path)
    parser.add_argument("second", type=Path)
    given = parser.parse_args()
    first, second = (
        {path.relative_to(folder) for path in folder.rglob("*") if path.suffix in FORMS and "raw" not in path.parts}
        for folder in (given.first, given.second)
    )
    differences = {path: difference(given.first / path, given.second / path) for path in sorted(first & second)}
    lines = [f"{path}: {problem}" for path, problem in differences.items() if problem]
    print(*lines, sep="\n", end="\n" * bool(lines))
    for folder, only in ((given.first, first - second), (given.second, second - first)):
        for path in sorted(only):
            print(f"{path}: only in {folder}")
    print(f"{len(differences)} files in both, {len(lines)} differ")
    sys.exit(bool(lines) or first != second)


if __name__ == "__main__":
    main()
