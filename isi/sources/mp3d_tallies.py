"""Matterport3D's objects by room, from published tallies."""

from __future__ import annotations

import csv
import re
from collections import Counter
from collections.abc import Collection, Iterator
from pathlib import Path

import pyarrow as pa

from isi.base import paths
from isi.base.errors import InputError
from isi.sources import Mining, source
from isi.sources._household import household
from isi.sources._mp3d import Counted, Rooms, entity_name, mine, read_vocabulary

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
    try:
        with path.open(encoding="utf-8", newline="") as file:
            reader = csv.DictReader(file, restval="")
            missing = set(COLUMNS) - set(reader.fieldnames or ())
            if missing:
                raise InputError(path, f"column {min(missing)!r}", "missing")
            seen = [_tally(path, reader.line_num, row) for row in reader]
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise InputError(path, "", f"expected a CSV file ({error})") from error
    twice = [pair for pair, times in Counter((one.category, one.region) for one in seen).items() if times > 1]
    if twice:
        raise InputError(path, "", f"{twice[0][0]!r} in {twice[0][1]!r} is listed twice")
    unknown = set(regions) - {one.region for one in seen}
    if unknown:
        raise InputError(path, f"room {min(unknown)!r}", "named in the setting rooms, but not here")
    return seen


def _tally(path: Path, line: int, row: dict[str, str]) -> Counted:
    category, region, count = (row[column] for column in COLUMNS)
    if not category or not region or not re.fullmatch(r"[0-9]+", count):
        raise InputError(path, f"line {line}", "expected an object, a room and a count")
    return Counted(None, None, region, entity_name(category), int(count))
