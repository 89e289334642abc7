"""Matterport3D's objects by room, from published tallies."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from pathlib import Path

import pyarrow as pa

from isi.errors import InputError, short
from isi.sources import Mining, source
from isi.sources._household import household
from isi.sources._mp3d import Counted, Rooms, entity_name, mine, read_vocabulary
from isi.sources._naming import fault
from isi.sources._rows import read_listed
from isi.tables import paths

COLUMNS = ("object", "room", "count")


@source("mp3d_tallies", entities=household)
def mp3d_tallies(mining: Mining, rooms: Rooms, vocabulary: str) -> Iterator[pa.Table]:
    """Observations of objects in rooms.

    Args:
        mining: counts what is left after each step.
        rooms: room of each type of region; other regions are left out.
        vocabulary: path of the file that says which categories are left out, and which have another name.
    """
    words = read_vocabulary(Path(vocabulary))
    return mine([tallies(paths.MP3D_TALLIES, rooms)], rooms, words, mining.left)


def tallies(path: Path, regions: Collection[str]) -> list[Counted]:
    """Published counts of objects by region type, over all houses.

    Args:
        path: CSV of ``object,room,count``.
        regions: types that must be there.

    Raises:
        InputError: where the file is missing or broken, lists a pair twice, or lacks one of the regions.
    """
    listed = read_listed(path, COLUMNS)
    seen: dict[tuple[str, str], Counted] = {}
    for line, category, region, count in listed.itertuples(name=None):
        name = entity_name(category)
        wrong = fault(name) or f"{short(name)} in {short(region)} is listed twice" * ((name, region) in seen)
        if wrong:
            raise InputError(path, f"line {line}", wrong)
        seen[name, region] = Counted(None, None, region, name, count)
    unknown = set(regions) - set(listed["room"])
    if unknown:
        raise InputError(path, f"room {short(min(unknown))}", "named in the setting rooms, but not here")
    return [*seen.values()]
