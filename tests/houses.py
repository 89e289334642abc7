"""Any number of houses, made of the recorded scenes: mined into a table by a process that reports what it took.

python -m tests.houses 10000 table.parquet --workers 2
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import os
import re
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import nullcontext
from itertools import cycle
from pathlib import Path

from isi import paths, tables
from isi.lifetime import tie_to_parent
from isi.params import load
from isi.scenes import ai2thor, materials
from isi.scenes.ai2thor import Object, Scene
from isi.tables import Provenance


def houses(scenes: Sequence[Scene], number: int) -> Iterator[Scene]:
    """The scenes over and over, each time with names of their own for the scene and its objects."""
    for house, scene in zip(range(number), cycle(scenes), strict=False):
        yield Scene(f"House{house}", house, scene.room, [_renamed(thing, house) for thing in scene.objects])


def _renamed(thing: Object, house: int) -> Object:
    parents = [f"{parent}|{house}" for parent in thing.get("parentReceptacles") or ()]
    return {**thing, "objectId": f"{thing['objectId']}|{house}", "parentReceptacles": parents}


def workers(number: int) -> ProcessPoolExecutor:
    """Worker processes that do not outlive this one."""
    spawn = multiprocessing.get_context("spawn")
    return ProcessPoolExecutor(number, spawn, initializer=tie_to_parent, initargs=(os.getpid(),))


def peak_mib(process: int) -> int:
    """The most memory that a process has held at a time (resident, MiB; Linux)."""
    status = Path(f"/proc/{process}/status").read_text(encoding="utf-8")
    return int(re.findall(r"VmHWM:\s+(\d+) kB", status)[0]) // 1024


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("houses", type=int)
    parser.add_argument("table", type=Path)
    parser.add_argument("--workers", type=int, default=0, help="processes to mine on; 0, the default: this one")
    given = parser.parse_args()
    start = time.perf_counter()
    params = load(paths.PARAMS)
    recording = ai2thor.locate(params.ai2thor.recording)
    made = houses(ai2thor.read_recording(recording, params.ai2thor.sha256), given.houses)
    shares = materials.read_shares(paths.MATERIAL_SHARES, paths.MATERIAL_CATEGORIES)
    with workers(given.workers) if given.workers else nullcontext() as executor:
        mined = ai2thor.mine(made, materials.suncg(shares, params.seed), recording, executor)
        rows = tables.write_stream(given.table, mined, tables.OBSERVATIONS, Provenance("houses", {}))
        children = [peak_mib(child.pid) for child in multiprocessing.active_children() if child.pid]
    seconds = round(time.perf_counter() - start, 1)
    peak = {"parent_mib": peak_mib(os.getpid()), "largest_child_mib": max(children, default=0)}
    print(json.dumps({"observations": rows, "seconds": seconds, **peak}))


if __name__ == "__main__":
    main()
