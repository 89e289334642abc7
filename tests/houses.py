"""Any number of houses, made of the recorded scenes: mined into a table by a process that reports what it took.

python -m tests.houses 10000 table.parquet
"""

from __future__ import annotations

import argparse
import json
import re
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from itertools import cycle
from pathlib import Path

from isi.config import read
from isi.sources import OBSERVATIONS, settings_of
from isi.sources.ai2thor import materials_of, mine
from isi.sources.recordings import Scene, SceneObject, locate, read_recording
from isi.tables import paths
from tests.observing import source_of


def houses(scenes: Sequence[Scene], number: int) -> Iterator[Scene]:
    """The scenes over and over, each time with names of their own for the scene and its objects."""
    for house, scene in zip(range(number), cycle(scenes), strict=False):
        yield Scene(f"House{house}", house, scene.room, [_renamed(thing, house) for thing in scene.objects])


def _renamed(thing: SceneObject, house: int) -> SceneObject:
    listed = {
        key: [f"{name}|{house}" for name in thing.get(key) or ()]
        for key in ("parentReceptacles", "receptacleObjectIds")
    }
    return {**thing, "objectId": f"{thing['objectId']}|{house}", **listed}


def peak_mib() -> int:
    """The most memory that this process has held at a time (resident, MiB; Linux)."""
    status = Path("/proc/self/status").read_text(encoding="utf-8")
    return int(re.findall(r"VmHWM:\s+(\d+) kB", status)[0]) // 1024


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("houses", type=int)
    parser.add_argument("table", type=Path)
    given = parser.parse_args()
    start = time.perf_counter()
    _, settings = settings_of(read(paths.PARAMS)["sources"]["ai2thor"], "sources.ai2thor")
    recording = locate(settings["from_"])
    made = houses(list(read_recording(recording, settings["sha256"])), given.houses)
    source = source_of(mine(made, materials_of("suncg", 0), recording, Counter()))
    rows = OBSERVATIONS.write_parts(given.table, source.tables(), "houses")
    seconds = round(time.perf_counter() - start, 1)
    print(json.dumps({"observations": rows, "seconds": seconds, "peak_mib": peak_mib()}))


if __name__ == "__main__":
    main()
