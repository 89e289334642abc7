"""Read every source in full; write its counts to docs/benchmarks/sources.md,
and its pictures to docs/sources/.

The sources are those of ``params.yaml``, of ``beyond/params.yaml`` and of the files of
``--params``. A source that cannot be read here is skipped with a message.

python -m tools.sources [NAME ...]
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
import pandas as pd
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure

from isi.config import Name, check, read
from isi.errors import InputError
from isi.process import errors_in_one_line
from isi.sources import Source
from isi.tables import paths
from stages.pipeline import BEYOND_PARAMS
from tools.docs import BENCHMARKS, write_table
from tools.figures import STYLE, rendered

TRIPLE = ["head", "relation", "tail"]
#: Maximum number of objects in a picture, or the number of its rooms if that is larger.
SHOWN = 25
NONE = "–"


def source_settings(files: Iterable[Path]) -> dict[str, Any]:
    """Settings of all sources and graphs in files of params, by name;
    ``InputError`` for a broken or repeated entry.
    """
    settings: dict[str, Any] = {}
    for file in files:
        params = read(file)
        sources, graphs = (
            check(params.get(key) or {}, dict[Name, dict[str, Any]], key, file)
            for key in ("sources", "graphs")
        )
        for name, section in [
            *sources.items(),
            *((name, graph.get("source")) for name, graph in graphs.items()),
        ]:
            if name in settings:
                raise InputError(file, name, "expected a name that no other source has")
            settings[name] = check(section, dict[str, Any], name, file)
    return settings


def measured(name: str, settings: Any, seed: int) -> tuple[dict[str, str], pd.DataFrame]:
    """Read a source in full; ``InputError`` if it cannot be read.

    Returns:
        its row of the table, as text; and the number of observations by object and room.
    """
    counts, seen = [], []
    start = time.perf_counter()
    source = Source(settings, f"sources.{name}", seed)
    for frame in source.frames():
        counts.append(frame.groupby(TRIPLE, observed=True)["count"].sum())
        instances = frame[["scene", "instance", "count"]]
        seen.append(instances.drop_duplicates(["scene", "instance"]).astype(object))
    seconds = time.perf_counter() - start
    total = pd.concat(counts).groupby(level=TRIPLE, observed=True).sum().rename("count")
    where = pd.concat(seen).drop_duplicates(["scene", "instance"])
    kinds = source.kinds["kind"].value_counts()
    steps = [f"{number:,} {step}" for step, number in source.counts.items() if number]
    row = {
        "source": name,
        "scenes": _number(where["scene"].nunique()),
        "rooms": _number(kinds.get("room", 0)),
        "instances": _number(int(where.loc[where["instance"].notna(), "count"].sum())),
        "observations": _number(int(total.sum())),
        "unique triples": _number(len(total)),
        "entities": _number(len(source.kinds)),
        "entities by kind": ", ".join(f"{number:,} {kind}" for kind, number in kinds.items()),
        "relations": _number(total.index.get_level_values("relation").nunique()),
        "counted by mining": "; ".join(steps) or NONE,
        "seconds": f"{seconds:.1f}",
    }
    rooms = source.kinds.loc[source.kinds["kind"] == "room", "entity"]
    of_rooms = total[total.index.get_level_values("tail").isin(rooms)]
    by_place = of_rooms.groupby(level=["head", "tail"], observed=True).sum()
    return row, by_place.unstack(fill_value=0)


def picture(name: str, seen: pd.DataFrame) -> Figure:
    """A heat map of the observations of the most frequent objects by room."""
    shown = most_frequent(seen)
    height, width = shown.shape
    with mpl.rc_context(STYLE):
        size = (3.2 + 0.25 * width, 1.8 + 0.18 * height)
        canvas = Figure(figsize=size, layout="constrained")
        axes = canvas.subplots()
        values, norm = shown.where(shown > 0), LogNorm(vmin=0.5)
        drawn = axes.imshow(values, cmap="Blues", norm=norm, aspect="auto")
        rooms = [f"{room} ({kinds})" for room, kinds in shown.columns]
        axes.set_xticks(range(width), rooms, rotation=90)
        axes.set_yticks(range(height), list(shown.index))
        axes.grid(visible=False)
        axes.set(title=f"where things are: {name}", xlabel="rooms (kinds of objects in them)")
        canvas.colorbar(drawn, label="observations")
    return canvas


def most_frequent(seen: pd.DataFrame) -> pd.DataFrame:
    """Restrict ``seen``, (objects, rooms), to the most frequent objects,
    with at least one object of each room.

    Objects are grouped by their most frequent room; rooms are sorted by number of objects, in
    labels (room, number).
    """
    kinds = (seen > 0).sum().sort_values(ascending=False)
    ordered = seen[kinds.index]
    place = ordered.rank(ascending=False, method="first").min(axis=1)
    chosen = ordered.loc[place.sort_values(kind="stable").index[: max(SHOWN, len(kinds))]]
    ordered = chosen.iloc[np.lexsort((-chosen.max(axis=1), chosen.to_numpy().argmax(axis=1)))]
    return ordered.set_axis(
        pd.Index(zip(kinds.index, kinds, strict=True), tupleize_cols=False), axis=1
    )


def _number(value: int) -> str:
    return f"{value:,}" if value else NONE


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "names", nargs="*", metavar="NAME", help="read these alone, and write no file"
    )
    parser.add_argument(
        "--params", type=Path, action="append", default=[], help="a YAML file with more sources"
    )
    given = parser.parse_args()
    sources = source_settings([paths.PARAMS, BEYOND_PARAMS, *given.params])
    if unknown := set(given.names) - set(sources):
        sys.exit(f"{min(unknown)!r}: expected one of {', '.join(sources)}")
    rows, seed, folder = [], read(paths.PARAMS)["seed"], BENCHMARKS.parent / "sources"
    for name in given.names or sources:
        try:
            row, seen = measured(name, sources[name], seed)
        except InputError as error:
            print(f"skipped {name}: {error}", file=sys.stderr)
            continue
        rows.append(row)
        if not (given.names or seen.empty):
            (folder / f"{name}.png").write_bytes(rendered(picture(name, seen), "png"))
    table = pd.DataFrame(rows)
    if given.names:
        print(table.to_markdown(index=False, disable_numparse=True))
    else:
        write_table("sources", table)


if __name__ == "__main__":
    with errors_in_one_line("sources"):
        main()
