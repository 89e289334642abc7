"""What commands about an embedding share: which one, how it is opened, and how answers are shown."""

from __future__ import annotations

import argparse
import json
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from isi.errors import InputError
from isi.tables import paths

if TYPE_CHECKING:
    from isi.bundle.answers import Answer, Question
    from isi.bundle.indicators import Indicator
    from isi.bundle.query import OpenBundle


#: The embedding that the pipeline keeps.
DEFAULT = paths.final_model("ai2thor")
#: Arguments of the library, by which options they came.
OPTIONS = {"argument 'initializer'": "--initializer", "argument 'entities'": "--embedding"}
#: Answers that are shown where nobody says how many.
TOP = 5


def add_arguments(parser: argparse.ArgumentParser, top: int | None = TOP) -> None:
    """Which embedding, how many answers, and whether a program reads them."""
    parser.add_argument(
        "--embedding", metavar="DIR", type=Path, default=DEFAULT,
        help="folder of an embedding, as --out, isi import and the pipeline write it (default: %(default)s)",
    )  # fmt: skip
    if top is not None:
        parser.add_argument("--top", metavar="N", type=number, default=top, help="how many (default: %(default)s)")
    parser.add_argument("--json", action="store_true", help="as JSON, for programs")


def number(text: str) -> int:
    """A whole number from 1."""
    if not text.isdecimal() or not 0 < len(text) < 10 or int(text) < 1:
        raise argparse.ArgumentTypeError(f"expected a whole number from 1, got {text[:40]!r}")
    return int(text)


def open_folder(path: Path) -> OpenBundle:
    """The embedding of a folder.

    Raises:
        InputError: where there is none, or it is broken.
    """
    from isi.bundle.folder import read
    from isi.bundle.query import open_bundle  # here, since it loads torch

    if path == DEFAULT and not path.exists():
        here = "the pipeline has not kept it yet (dvc repro train_final): run it"
        away = f"{Path.cwd()} is not the folder of the project: go there first"
        expected = here if paths.PARAMS.exists() else away
        raise InputError(path, "", f"{expected}, or name another by --embedding DIR")
    import torch

    torch.set_num_threads(1)  # so that equal commands write equal bytes
    return open_bundle(read(path), path)


def out_folder(text: str) -> Path:
    """A folder to write: one that a whole new one can take the place of."""
    path = Path(text)
    if path.name in ("", ".."):
        raise argparse.ArgumentTypeError(f"expected a folder by its name, got {text[:40]!r}")
    return path


def refuse_to_lose(folder: Path, names: Collection[str]) -> None:
    """Refuse to write where an embedding has entities inserted that the new one lacks, which has entities ``names``.

    Raises:
        InputError: naming them.
    """
    from isi.bundle.folder import ABOUT

    try:
        inserted = [str(one["entity"]) for one in json.loads((folder / ABOUT).read_bytes())["inserted"]]
    except OSError:  # nothing is there
        return
    except (ValueError, LookupError, TypeError, RecursionError) as error:
        expected = "expected another folder: there is an embedding, and nobody can tell what would be lost of it"
        raise InputError("--out", str(folder), expected) from error
    if lost := [name for name in inserted if name not in names]:
        expected = (
            f"expected another folder: there, {', '.join(lost)} would be lost (`isi insert --embedding` adds to it)"
        )
        raise InputError("--out", str(folder), expected)


@contextmanager
def as_option(places: Mapping[str, str] = OPTIONS, initializer: str | None = None) -> Iterator[None]:
    """Mistakes that are said of an argument of the library, said of the option or file that it came by.

    Args:
        places: these, by argument.
        initializer: which was asked for, and may have options by ``--set``.
    """
    try:
        yield
    except InputError as error:
        place, within, expected = error.args
        if initializer is not None and place == "argument 'initializer'" and within not in ("", initializer):
            raise InputError(f"--set {within}", "", expected) from error
        raise InputError(places.get(place, place), within, expected) from error


def as_json(value: Mapping[str, Any]) -> str:
    """One JSON document, in ASCII."""
    return json.dumps(value, indent=2, allow_nan=False)


def columns(rows: Iterable[Sequence[str]], indent: int = 2) -> Iterator[str]:
    """Lines of a table whose cells are as wide as their column; the last column is not filled."""
    listed = [list(row) for row in rows]
    widths = [max(map(len, column)) for column in zip(*listed, strict=True)]
    for row in listed:
        cells = [cell.ljust(width) for cell, width in zip(row, widths, strict=True)]
        yield (" " * indent + "  ".join(cells)).rstrip()


def percent(share: float | None) -> str:
    """A share, in per cent."""
    if share is None:
        return ""
    return "<1 %" if 0 < share < 0.005 else f"{100 * share:.0f} %"


def decimal(value: float | None) -> str:
    return "" if value is None else f"{value:.2f}"


def asked(model: OpenBundle, question: Question) -> tuple[str, str, str]:
    """A question as a triple, with a question mark."""
    from isi.graph.graph import TAIL

    given, relation = model.kept.entity_names[question.given], model.kept.relation_names[question.relation]
    return (given, relation, "?") if question.slot == TAIL else ("?", relation, given)


def answer_lines(answers: Sequence[Answer], notes: Sequence[str]) -> Iterator[str]:
    """Ranked answers: how good each is, and a note."""
    shares = [percent(answer.beats if answer.chance is None else answer.chance) for answer in answers]
    yield from columns(
        ((f"{answer.rank:>3}", share.rjust(5), answer.entity, note)
         for answer, share, note in zip(answers, shares, notes, strict=True)), indent=4,
    )  # fmt: skip


def meaning(answers: Iterable[Answer], inserted: bool) -> str:
    """What the share in front of answers is."""
    if any(answer.chance is None for answer in answers):
        return "per cent: of the other entities, how many score lower"
    if inserted:
        return "per cent: how often such an answer was right of known entities, inserted as this one"
    return "per cent: how often an answer of this relation with such a score is known"


def answer_json(answer: Answer) -> dict[str, Any]:
    return {
        "rank": answer.rank, "entity": answer.entity, "score": answer.score, "chance": answer.chance,
        "beats": answer.beats, "known": answer.known,
    }  # fmt: skip


def indicator_lines(model: OpenBundle, shown: Sequence[Indicator]) -> Iterator[str]:
    """A table of indicators, without the columns of what there is not."""
    chosen = any(one.weight is not None for one in shown)
    rows = [("indicator" if chosen else "most similar", "weight", "words", "relations")] + [
        (model.kept.entity_names[one.entity], percent(one.weight), decimal(one.words), decimal(one.relations))
        for one in shown
    ]
    used = [number for number, column in enumerate(zip(*rows[1:], strict=True)) if any(column)]
    yield from columns([row[number] for number in used] for row in rows)


def indicator_json(model: OpenBundle, one: Indicator) -> dict[str, Any]:
    return {
        "entity": model.kept.entity_names[one.entity], "weight": one.weight, "words": one.words,
        "relations": one.relations,
    }  # fmt: skip
