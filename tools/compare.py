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


def different(first: Path, second: Path) -> str | None:
    """What differs between two files, in a few words; None where nothing does."""
    if first.suffix == ".safetensors":
        one, other = load_file(first), load_file(second)
        names = [name for name in one.keys() | other.keys() if not _same(one.get(name), other.get(name))]
        return f"tensors {', '.join(sorted(names))}" if names else None
    if first.suffix != ".parquet":
        return None if first.read_bytes() == second.read_bytes() else "bytes"
    left, right = (pd.read_parquet(path) for path in (first, second))
    if len(left) != len(right):
        return f"{len(left)} rows against {len(right)}"
    columns = [name for name in left.columns.intersection(right.columns) if not _same_column(left[name], right[name])]
    apart = sorted(set(left.columns) ^ set(right.columns))
    said = [f"columns {', '.join(columns)}"] * bool(columns) + [f"only in one: {', '.join(apart)}"] * bool(apart)
    return "; ".join(said) or None


def _same(one: np.ndarray | None, other: np.ndarray | None) -> bool:
    return one is not None and other is not None and one.dtype == other.dtype and one.tobytes() == other.tobytes()


def _same_column(one: pd.Series, other: pd.Series) -> bool:
    plain = [column.astype(str) if column.dtype == "category" else column for column in (one, other)]
    return plain[0].reset_index(drop=True).equals(plain[1].reset_index(drop=True))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("first", type=Path)
    parser.add_argument("second", type=Path)
    given = parser.parse_args()
    files = [
        {path.relative_to(folder) for path in folder.rglob("*") if path.suffix in FORMS and "raw" not in path.parts}
        for folder in (given.first, given.second)
    ]
    found = {path: different(given.first / path, given.second / path) for path in sorted(files[0] & files[1])}
    for path, what in found.items():
        if what:
            print(f"{path}: {what}")
    for folder, only in ((given.first, files[0] - files[1]), (given.second, files[1] - files[0])):
        for path in sorted(only):
            print(f"{path}: only in {folder}")
    print(f"{len(found)} files in both, {sum(what is not None for what in found.values())} differ")
    sys.exit(any(found.values()) or files[0] != files[1])


if __name__ == "__main__":
    main()
