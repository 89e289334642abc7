"""Fill the column ``definition`` of data/raw/words/wordnet.csv with WordNet's
definitions of its synsets.

    python -m tools.wordnet FOLDER

FOLDER has the files of WordNet 3.0 (index.noun, data.noun, ...), whose senses the synsets number. A
phrase without a synset gets an empty definition.
"""

import argparse
import re
from functools import cache
from pathlib import Path

import pandas as pd

from isi.errors import InputError
from isi.process import errors_in_one_line
from isi.tables.io import atomically
from tools.embed_phrases import WORDNET

FILES = {"n": "noun", "v": "verb", "a": "adj", "s": "adj", "r": "adv"}


def main() -> None:
    parser = argparse.ArgumentParser(
        prog="python -m tools.wordnet", description=(__doc__ or "").partition("\n\n")[0]
    )
    parser.add_argument(
        "folder", type=Path, help="the files of WordNet 3.0: index.noun, data.noun, ..."
    )
    folder, table = (
        parser.parse_args().folder,
        pd.read_csv(WORDNET, keep_default_na=False, dtype=str),
    )
    with errors_in_one_line("wordnet"):
        definitions = [definition(folder, synset) if synset else "" for synset in table["synset"]]
    written = table.assign(definition=definitions).sort_values("phrase")[
        ["phrase", "definition", "synset"]
    ]
    atomically(
        WORDNET, lambda temporary: written.to_csv(temporary, index=False, lineterminator="\n")
    )
    print(
        f"{WORDNET}: {(written['definition'] != '').sum()} of "
        f"{len(written)} phrases have a definition"
    )


def definition(folder: Path, synset: str) -> str:
    """The definition of a synset named as in NLTK:
    ``mug.n.04`` is the fourth sense of the noun ``mug``.

    Raises:
        InputError: if the name is malformed or WordNet has no such sense.
    """
    named = re.fullmatch(r"(\S+)\.([nvasr])\.([0-9]{2})", synset)
    if not named:
        raise InputError(
            WORDNET, f"synset {synset!r}", "expected WORD.PART_OF_SPEECH.SENSE, such as mug.n.04"
        )
    file, sense = FILES[named[2]], int(named[3])
    senses = _index(folder / f"index.{file}").get(named[1], [])
    if not 1 <= sense <= len(senses):
        raise InputError(
            WORDNET, f"synset {synset!r}", f"expected one of {len(senses)} senses of {named[1]!r}"
        )
    line = (
        _content(folder / f"data.{file}")[senses[sense - 1] :].split(b"\n", 1)[0].decode("latin-1")
    )
    return re.split(r';?\s*"', line.partition(" | ")[2], maxsplit=1)[0].strip()


@cache
def _index(path: Path) -> dict[str, list[int]]:
    """For each word, the byte offsets of its synsets in WordNet's data file,
    in the order of senses.
    """
    offsets = {}
    for line in _content(path).decode("latin-1").splitlines():
        if not line.startswith(" "):
            fields = line.split()
            offsets[fields[0]] = [int(offset) for offset in fields[-int(fields[2]) :]]
    return offsets


@cache
def _content(path: Path) -> bytes:
    try:
        return path.read_bytes()
    except OSError as error:
        raise InputError(path, "", f"expected a file of WordNet ({error.strerror})") from error


if __name__ == "__main__":
    main()
