"""Mistakes in the input of ``isi import``."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import torch

from tests.mistakes.calls import Typed, packed
from tests.mistakes.commands import changed
from tests.small_bundle import ENTITIES, LABELS, write_lists

TYPED = "import mine --model distmult --out out"
NAMED = [f"{place}\t{name}" for place, name in enumerate("abcdef")]
OF_PYKEEN = [f"{slot}_representations.0._embeddings.weight" for slot in ("entity", "relation")]


def with_tables(**changed: Any) -> Callable[[], object]:
    """A function that writes names and tables, with changes by name;
    None: the tensor is missing.
    """
    given = {"entities": ENTITIES, "relations": LABELS, **changed}
    return lambda: write_lists(
        **{name: table for name, table in given.items() if table is not None}
    )


def with_file(
    name: str,
    content: str | bytes,
    folder: Callable[[], Path] = with_tables(),  # noqa: B008
) -> Callable[[], object]:  # type: ignore[assignment]
    """A function that calls ``folder``, and then replaces the content of one file."""

    def write() -> None:
        (folder() / name).write_bytes(content if isinstance(content, bytes) else content.encode())

    return write


def with_state(value: object) -> Callable[[], object]:
    return lambda: torch.save(value, write_lists() / "t.pt")


def of_pykeen() -> None:
    """Write a folder as PyKEEN does, without a model."""
    files = {
        "entity_to_id": packed("id\tlabel", *NAMED),
        "relation_to_id": packed("id\tlabel", "0\tp", "1\tq"),
        "numeric_triples": packed("head\trelation\ttail", "0\t1\t2"),
    }
    folder = Path("theirs/training_triples")
    folder.mkdir(parents=True)
    for name, content in files.items():
        (folder / f"{name}.tsv.gz").write_bytes(content)


def not_compressed() -> None:
    of_pykeen()
    Path("theirs/training_triples/entity_to_id.tsv.gz").write_text("id\tlabel\n", "utf-8")


def corrupt() -> None:
    """Write an archive with a valid beginning and corrupt compressed data."""
    np.savez_compressed(write_lists() / "tables.npz", entities=ENTITIES)
    path = Path("mine/tables.npz")
    content = bytearray(path.read_bytes())
    start = content.index(b"entities.npy") + len(b"entities.npy")
    content[start + 20 : start + 60] = b"\xff" * 40
    path.write_bytes(content)


def infinite() -> np.ndarray:
    table = ENTITIES.copy()
    table[2, 1] = np.inf
    return table


COMMAND_CASES = [
    Typed(
        "no triples to estimate a margin from",
        "import mine --model transe --out out",
        "--set|margin",
        before=lambda: (write_lists(entities=ENTITIES, relations=LABELS) / "triples.tsv").unlink(),
    ),
    Typed(
        "a width that the model does not have",
        "import mine --model complex --out out",
        "--model|dimension",
        before=with_tables(entities=ENTITIES[:, :3], relations=LABELS[:, :3]),
    ),
    Typed(
        "a home with changes",
        f"{TYPED[:-3]}home",
        "home|1 changes",
        before=lambda: (with_tables()(), changed()),
    ),
]

#: Texts of the message, and the function that writes the folder ``mine``.
TABLES: list[tuple[str, Callable[[], object]]] = [
    ("tables.npz|entities", with_tables(entities=np.full(ENTITIES.shape, 1e200))),
    ("tables.npz|entities", with_tables(entities=ENTITIES[:5])),
    ("tables.npz|entities", with_tables(entities=infinite())),
    ("tables.npz|entities", with_tables(entities=ENTITIES[0])),
    ("tables.npz|entities", with_tables(entities=np.array([["a"]]))),
    ("tables.npz|relations", with_tables(relations=LABELS[:, :3])),
    ("tables.npz", with_tables(entities=np.array([{}, None]))),  # Python's objects
    ("tables.npz", corrupt),
    ("t.pt", with_file("t.pt", b"\x80\x02cos\nmkdir\nq\x00.", write_lists)),
    ("t.pt", with_state([torch.ones(2)])),
    ("entities.txt", with_file("entities.txt", b"\xff")),
]
TENSOR_CASES = [
    *(
        Typed(f"a broken {names}", TYPED, f"mine/{names}", before=before)
        for names, before in TABLES
    ),
    Typed(
        "half a complex number, of PyKEEN",
        "import mine --model complex --out out",
        "mine/tables.npz",
        before=lambda: write_lists(
            **dict(zip(OF_PYKEEN, (ENTITIES[:, :3], LABELS[:, :3]), strict=True))
        ),
    ),
]

IMPORT_CASES = [*COMMAND_CASES, *TENSOR_CASES]
