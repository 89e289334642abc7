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
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
import pandas as pd
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure

from isi.config import Name, check, read
from isi.errors import InputError
from isi.sources import Source
from isi.tables import paths
from tools.docs import BENCHMARKS, write_table
from tools.figures import STYLE, rendered

TRIPLE = ["head", "relation", "tail"]
#: Maximum number of objects in a picture, or the number of its rooms if that is larger.
SHOWN = 25
NONE = "–"


@dataclass(frozen=True)
class Measured:
    """The counts of a source that was read in full, and the seconds that it took."""

    name: str
    scenes: int
    instances: int
    counts: pd.Series[int]  #: number of observations of each unique triple
    kinds: pd.DataFrame  #: entities (rows of ``isi.sources.KINDS``)
    left: Mapping[str, int]  #: number of instances that each step of mining leaves
    seconds: float

    def of_kind(self, kind: str) -> list[str]:
        return list(self.kinds.loc[self.kinds["kind"] == kind, "entity"])


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


def run(name: str, settings: Any, seed: int) -> Measured:
    """Read a source in full; ``InputError`` if it cannot be read."""
    counts, seen = [], []
    start = time.perf_counter()
    source = Source(settings, f"sources.{name}", seed)
    for frame in source.frames():
        counts.append(frame.groupby(TRIPLE, observed=True)["count"].sum())
        seen.append(
            frame[["scene", "instance", "count"]]
            .drop_duplicates(["scene", "instance"])
            .astype(object)
        )
    seconds = time.perf_counter() - start
    total = pd.concat(counts).groupby(level=TRIPLE, observed=True).sum()
    where = pd.concat(seen).drop_duplicates(["scene", "instance"])
    instances = int(where.loc[where["instance"].notna(), "count"].sum())
    return Measured(
        name, where["scene"].nunique(), instances, total, source.kinds, source.counts, seconds
    )


def table(measured: Iterable[Measured]) -> pd.DataFrame:
    """A table of counts as text, with a row for each source."""
    return pd.DataFrame(
        [
            {
                "source": source.name,
                "scenes": _number(source.scenes),
                "rooms": _number(len(source.of_kind("room"))),
                "instances": _number(source.instances),
                "observations": _number(int(source.counts.sum())),
                "unique triples": _number(len(source.counts)),
                "entities": _number(len(source.kinds)),
                "entities by kind": ", ".join(
                    f"{n:,} {kind}" for kind, n in source.kinds["kind"].value_counts().items()
                ),
                "relations": _number(source.counts.index.get_level_values("relation").nunique()),
                "counted by mining": "; ".join(
                    f"{n:,} {step}" for step, n in source.left.items() if n
                )
                or NONE,
                "seconds": f"{source.seconds:.1f}",
            }
            for source in measured
        ]
    )


def picture(measured: Measured) -> Figure | None:
    """A heat map of the observations of the most frequent objects by room;
    None for a source without rooms.
    """
    rooms = measured.counts[
        measured.counts.index.get_level_values("tail").isin(measured.of_kind("room"))
    ]
    if rooms.empty:
        return None
    shown = most_frequent(
        rooms.groupby(level=["head", "tail"], observed=True).sum().unstack(fill_value=0)
    )
    with mpl.rc_context(STYLE):
        canvas = Figure(
            figsize=(3.2 + 0.25 * shown.shape[1], 1.8 + 0.18 * len(shown)), layout="constrained"
        )
        axes = canvas.subplots()
        drawn = axes.imshow(
            shown.where(shown > 0), cmap="Blues", norm=LogNorm(vmin=0.5), aspect="auto"
        )
        axes.set_xticks(
            range(shown.shape[1]),
            [f"{room} ({kinds})" for room, kinds in shown.columns],
            rotation=90,
        )
        axes.set_yticks(range(len(shown)), list(shown.index))
        axes.grid(visible=False)
        axes.set(
            title=f"where things are: {measured.name}", xlabel="rooms (kinds of objects in them)"
        )
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
        "names",
        nargs="*",
        metavar="NAME",
        help="read these alone, and write no file without --docs",
    )
    parser.add_argument(
        "--params", type=Path, action="append", default=[], help="a YAML file with more sources"
    )
    parser.add_argument("--docs", type=Path, help="folder of the table and the pictures (docs)")
    given = parser.parse_args()
    docs = given.docs or (None if given.names else BENCHMARKS.parent)
    try:
        sources = source_settings([paths.PARAMS, paths.BEYOND_PARAMS, *given.params])
        if unknown := set(given.names) - set(sources):
            sys.exit(f"{min(unknown)!r}: expected one of {', '.join(sources)}")
        measured, seed = [], read(paths.PARAMS)["seed"]
        for name in given.names or sources:
            try:
                measured.append(run(name, sources[name], seed))
            except InputError as error:
                print(f"skipped {name}: {error}", file=sys.stderr)
        if docs is None:
            print(table(measured).to_markdown(index=False, disable_numparse=True))
            return
        write_table("sources", table(measured), docs / "benchmarks")
        (docs / "sources").mkdir(parents=True, exist_ok=True)
        for source in measured:
            if drawn := picture(source):
                (docs / "sources" / f"{source.name}.png").write_bytes(rendered(drawn, "png"))
    except InputError as error:
        sys.exit(str(error))


if __name__ == "__main__":
    main()
