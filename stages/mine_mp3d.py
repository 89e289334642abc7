"""Mine Matterport3D's objects by room into observations."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from pathlib import Path

from isi import paths, tables
from isi.scenes import mp3d
from isi.scenes.mp3d import Seen, Vocabulary
from isi.stage import Params, Provenance, stage


@stage("mp3d.source", "mp3d.houses", "mp3d.category", "mp3d.rooms", "mp3d.structure", "mp3d.same_as")
def mine_mp3d(params: Params, provenance: Provenance) -> None:
    """Mine Matterport3D's objects by room into observations."""
    given = params.mp3d
    batches: Iterable[list[Seen]]
    if given.source == "house" and given.houses:  # which that source requires
        batches, rooms = mp3d.houses(Path(given.houses), given.category), given.rooms.house
    else:
        batches, rooms = [mp3d.tallies(paths.MP3D_TALLIES, given.rooms.tallies)], given.rooms.tallies
    left: Counter[str] = Counter()
    mined = mp3d.mine(batches, Vocabulary(rooms, given.structure, given.same_as), left)
    rows = tables.write_stream(paths.observations("mp3d"), mined, tables.OBSERVATIONS, provenance)
    print("; ".join(f"{left[step]:,} {step}" for step in mp3d.STEPS))
    print(f"{rows:,} observations of {left[mp3d.STEPS[-1]]:,} instances")


if __name__ == "__main__":
    mine_mp3d()
