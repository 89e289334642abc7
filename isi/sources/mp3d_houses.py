"""Observations of the objects in Matterport3D's own house files."""

import re
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field

from isi.errors import InputError, short
from isi.names import check_name, name_fault
from isi.sources import Mining, Observation, reader
from isi.sources.mp3d import Tally, category_name, mine
from isi.sources.names import household
from isi.sources.readers import read_text, reading

#: By version of the format: kinds of records in the order of the header's counts (``P`` occurs
#: twice).
HEADERS = {"1.0": "IPVSRL", "1.1": "IPVSEOCRPL"}
RECORD_KINDS = tuple("IPVSEOCRL")
#: Place of a category's name among the fields of a record ``C``; 0 is the field after the letter.
CATEGORY_FIELD = {"category_mapping_name": 2, "mpcat40": 4}
#: Settings: room by label of region (other regions are omitted), and which name of a category.
HouseRooms = Annotated[
    dict[Annotated[str, Field(pattern=r"^[a-pr-zBCDSZ]$")], str], Field(min_length=1)
]
Category = Literal["category_mapping_name", "mpcat40"]


@reader("mp3d_houses", household, path="folder")
def mp3d_houses(
    mining: Mining, folder: str, category: Category, rooms: HouseRooms, vocabulary: str
) -> Iterator[Observation]:
    """Observations from Matterport3D's houses,
    the files ``*.house`` in ``folder`` and its subfolders.

    ``category`` selects one of a category's two names; ``rooms``: room by label of region;
    ``vocabulary``: a YAML file.
    """
    return mine(
        _read_houses(Path(folder), CATEGORY_FIELD[category]), rooms, Path(vocabulary), mining.counts
    )


def _read_houses(folder: Path, category_field: int) -> Iterator[list[Tally]]:
    """Objects by ``*.house`` file in a folder and its subfolders, sorted by path;
    InputError for a repeated house.
    """
    content = "a folder with *.house files, unpacked"
    with reading(folder, content):
        files = sorted(path for path in folder.rglob("*.house") if path.is_file())
    if not files:
        raise InputError(folder, "", f"expected {content}")
    path_of: dict[str, Path] = {}
    for path in files:
        house, tallies = _read_house(path, category_field)
        if path_of.setdefault(house, path) != path:
            raise InputError(path, f"house {short(house)}", f"is also in {path_of[house]}")
        yield tallies


def _read_house(path: Path, category_field: int) -> tuple[str, list[Tally]]:
    """The name of a house and its objects; regions and categories may be
    listed after the objects.
    """
    first, *lines = read_text(path, "a .house file").split("\n")
    version = re.fullmatch(r"ASCII\s+(\S+)\s*", first)
    if not version or version[1] not in HEADERS:
        raise InputError(
            path, "line 1", "expected a .house file, which starts with ASCII 1.0 or ASCII 1.1"
        )
    layouts: dict[str, tuple[Callable[[str], Any], list[int]]] = {  # conversion, fields
        "R": (str, [4]),
        "C": (category_name, [category_field]),
        "O": (_integer, [1, 2]),
    }
    numbered: dict[str, dict[int, list[Any]]] = {kind: {} for kind in layouts}
    counts, expected = Counter[str](), Counter[str]()
    records = ((line, text.split()) for line, text in enumerate(lines, 2) if text.strip())
    header, (kind, *fields) = next(records, (2, [""]))
    line = header
    try:
        if kind != "H":
            raise ValueError("expected the header, a record H")
        house = check_name(fields[0].replace("#", " "))
        for place, letter in enumerate(HEADERS[version[1]], 2):
            expected[letter] += _integer(fields[place])
        for line, (kind, *fields) in records:
            counts[kind] += 1
            if kind in layouts:
                number, (convert, places) = _integer(fields[0]), layouts[kind]
                if number in numbered[kind]:
                    raise ValueError(f"{kind} {number} is in the file twice")
                numbered[kind][number] = [line, *(convert(fields[place]) for place in places)]
            elif kind not in RECORD_KINDS:
                raise ValueError(
                    f"expected a record of one of the kinds {', '.join(RECORD_KINDS)}, "
                    f"got {short(kind)}"
                )
    except (ValueError, IndexError) as error:
        too_few = f"{len(fields) + 1} fields are too few for a record {kind}"
        raise InputError(
            path, f"line {line}", too_few if isinstance(error, IndexError) else str(error)
        ) from error
    if wrong := next((kind for kind in expected if counts[kind] != expected[kind]), None):
        problem = (
            f"the header counts {expected[wrong]} records {wrong}, the file has {counts[wrong]}"
        )
        raise InputError(path, f"line {header}", problem)
    return house, list(_objects(path, house, numbered))


def _objects(
    path: Path, house: str, numbered: Mapping[str, Mapping[int, list[Any]]]
) -> Iterator[Tally]:
    """Objects of a house, from its records (line, then values) by kind and number."""
    for number, (line, *ends) in numbered["O"].items():
        names = []
        for kind, end in zip("RC", ends, strict=True):
            names.append(numbered[kind].get(end, [0, ""])[1])
            if (fault := name_fault(names[-1])) and (end in numbered[kind] or end != -1):
                problem = (
                    f"object {number} is of {kind} {end}, a record that is "
                    f"missing or has no valid name: {fault}"
                )
                raise InputError(path, f"line {line}", problem)
        yield house, str(number), names[0], names[1], 1


def _integer(text: str) -> int:
    if not re.fullmatch(r"-?[0-9]{1,9}", text):
        raise ValueError(f"expected a whole number of at most nine digits, got {short(text)}")
    return int(text)
