"""Mistakes in what ``isi import`` reads."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import torch

from isi.bundle.importer import OF_PYKEEN
from tests.import_folders import ENTITIES, LABELS, write_lists, write_openke
from tests.mistakes.calls import Typed, packed
from tests.mistakes.commands import inserted_elsewhere

TYPED = "import mine --family distmult --out out"
THEIRS = "import theirs --family distmult --out out"
NAMED = [f"{place}\t{name}" for place, name in enumerate("abcdef")]
RE, IM, OF = "ent_re_embeddings.weight", "ent_im_embeddings.weight", "rel_emb"


def with_tables(**changed: Any) -> Callable[[], object]:
    """Names with tables, some of them others than they should be; null: not there."""
    given = {"entities": ENTITIES, "relations": LABELS, **changed}
    return lambda: write_lists(**{name: table for name, table in given.items() if table is not None})


def with_file(name: str, content: str | bytes, folder: Callable[[], Path] = with_tables()) -> Callable[[], object]:  # type: ignore[assignment]  # noqa: B008
    """Names and tables, and a file of other content."""

    def write() -> None:
        (folder() / name).write_bytes(content if isinstance(content, bytes) else content.encode())

    return write


def with_state(value: object) -> Callable[[], object]:
    return lambda: torch.save(value, write_lists() / "t.pt")


def of_pykeen(**changed: bytes | None) -> Callable[[], object]:
    """A folder as PyKEEN saves one, without a model."""
    files = {"entity_to_id": packed("id\tlabel", *NAMED), "relation_to_id": packed("id\tlabel", "0\tp", "1\tq"),
             "numeric_triples": packed("head\trelation\ttail", "0\t1\t2"), **changed}  # fmt: skip

    def write() -> None:
        folder = Path("theirs/training_triples")
        folder.mkdir(parents=True)
        for name, content in files.items():
            if content is not None:
                (folder / f"{name}.tsv.gz").write_bytes(content)

    return write


def with_pickle(content: bytes | None) -> Callable[[], object]:
    def write() -> None:
        of_pykeen()()
        path = Path("theirs/trained_model.pkl")
        if content is None:
            torch.save(None, path)
        else:
            path.write_bytes(content)

    return write


def of_rescal() -> None:
    """A model whose family has no closed form."""
    from pykeen.models import RESCAL
    from pykeen.triples import CoreTriplesFactory

    of_pykeen()()
    factory = CoreTriplesFactory(torch.tensor([[0, 1, 2]]), 6, 2)
    torch.save(RESCAL(triples_factory=factory, embedding_dim=4, random_seed=0), "theirs/trained_model.pkl")


def corrupt() -> None:
    """An archive that begins as one, and cannot be inflated."""
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


TYPED_CASES = [
    Typed("no folder to write", "import mine", "--out", status=2),
    Typed("a setting that is none", "import mine --set margin --out out", "--set", status=2),
    Typed("no family", "import mine --out out", "--family", before=with_tables()),
    Typed("settings beside a pickle", "import mine --trust-pickle --set margin=2 --out out", "--trust-pickle",
          before=write_lists),
    Typed("a folder with nothing in it", TYPED, "mine"),
    Typed("no tensors", TYPED, "mine", before=write_lists),
    Typed("no such file of tensors", f"{TYPED} --tensors t.npz", "t.npz", before=write_lists),
    Typed("tensors of another form", f"{TYPED} --tensors t.h5", "t.h5", before=write_lists),
    Typed("an option that the family does not have", f"{TYPED} --set margin=2", "--family|margin",
          before=with_tables()),
    Typed("a margin that nothing tells", "import mine --family transe --out out", "--set|margin",
          before=lambda: (write_lists(entities=ENTITIES, relations=LABELS) / "triples.tsv").unlink()),
    Typed("a name that the folder does not have where it is to be written", f"{TYPED[:-3]}log.csv", "log.csv",
          before=with_tables()),
    Typed("numbers of which a score would be none", TYPED, "mine|entities",
          before=with_tables(entities=np.full(ENTITIES.shape, 1e200))),
    Typed("a folder with an embedding that others were inserted into", f"{TYPED[:-3]}other", "other",
          before=lambda: (with_tables()(), inserted_elsewhere())),
]  # fmt: skip

TENSOR_CASES = [
    Typed("too few rows", TYPED, "mine/tables.npz|entities", before=with_tables(entities=ENTITIES[:5])),
    Typed("too few rows, where triples tell the margin", "import mine --family transe --out out", "mine/tables.npz",
          before=with_tables(entities=ENTITIES[:3])),
    Typed("relations of another width", TYPED, "mine/tables.npz|relations", before=with_tables(relations=LABELS[:,
          :3])),
    Typed("the same, where triples tell the margin", "import mine --family transe --out out",
          "mine/tables.npz|relations", before=with_tables(relations=LABELS[:, :3])),
    Typed("a width that the family does not have", "import mine --family complex --out out", "--family|dimension",
          before=with_tables(entities=ENTITIES[:, :3], relations=LABELS[:, :3])),
    Typed("infinity", TYPED, "mine/tables.npz|entities", before=with_tables(entities=infinite())),
    Typed("one dimension", TYPED, "mine/tables.npz|entities", before=with_tables(entities=ENTITIES[0])),
    Typed("texts", TYPED, "mine/tables.npz|entities", before=with_tables(entities=np.array([["a"]]))),
    Typed("half a complex number, of PyKEEN", "import mine --family complex --out out", "mine/tables.npz",
          before=lambda: write_lists(**dict(zip(OF_PYKEEN, (ENTITIES[:, :3], LABELS[:, :3]), strict=True)))),
    Typed("halves of two widths", "import mine --family complex --out out",
          "mine/tables.npz|ent_im_embeddings.weight",
          before=with_tables(entities=None, relations=None, **{RE: ENTITIES, IM: ENTITIES[:, :3], OF: LABELS})),
    Typed("tensors by other names", TYPED, "mine/tables.npz", before=with_tables(entities=None, relations=None,
          vectors=ENTITIES)),
    Typed("a broken archive", TYPED, "mine/tables.npz", before=corrupt),
    Typed("Python's objects", TYPED, "mine/tables.npz", before=with_tables(entities=np.array([{}, None]))),
    Typed("a number beyond all", TYPED, "mine/t.json", before=with_file("t.json",
          f'{{"entities": [[1{"0" * 400}]]}}', write_lists)),
    Typed("JSON of something else", TYPED, "mine/t.json", before=with_file("t.json", "[]", write_lists)),
    Typed("a pickle that is no state dict", TYPED, "mine/t.pt", before=with_file("t.pt",
          b"\x80\x02cos\nmkdir\nq\x00.", write_lists)),
    Typed("PyTorch's file of something else", TYPED, "mine/t.pt", before=with_state([torch.ones(2)])),
]  # fmt: skip

NAME_CASES = [
    Typed("names in another encoding", TYPED, "mine/entities.txt", before=with_file("entities.txt", b"\xff")),
    Typed("a name twice", TYPED, "mine/relations.txt|line 2", before=with_file("relations.txt", "x\nx\n")),
    Typed("a blank name", TYPED, "mine/relations.txt|line 2", before=with_file("relations.txt", "x\n\n")),
    Typed("a triple of two columns", TYPED, "mine/triples.tsv|line 1", before=with_file("triples.tsv", "a\tb\n")),
    Typed("a triple of a name that is not there", TYPED, "mine/triples.tsv|line 1", before=with_file("triples.tsv",
          "a\tb\tc\n")),
    Typed("OpenKE's names, fewer than the first line says", THEIRS, "theirs/entity2id.txt|line 1",
          before=with_file("entity2id.txt", "2\na\t0\n", write_openke)),
    Typed("a folder of PyKEEN's without labels", THEIRS, "theirs/training_triples/entity_to_id.tsv.gz",
          before=of_pykeen(entity_to_id=None)),
    Typed("labels that are not compressed", THEIRS, "theirs/training_triples/entity_to_id.tsv.gz",
          before=of_pykeen(entity_to_id=b"id\tlabel\n")),
    Typed("labels with another header", THEIRS, "theirs/training_triples/entity_to_id.tsv.gz|line 1",
          before=of_pykeen(entity_to_id=packed("label\tid"))),
    Typed("labels without some ids", THEIRS, "theirs/training_triples/entity_to_id.tsv.gz",
          before=of_pykeen(entity_to_id=packed("id\tlabel", "0\ta", "2\tb"))),
    Typed("triples that are no ids", THEIRS, "theirs/training_triples/numeric_triples.tsv.gz",
          before=of_pykeen(numeric_triples=packed("head\trelation\ttail", "a\tp\tb"))),
    Typed("triples of ids that are not there", THEIRS, "theirs/training_triples/numeric_triples.tsv.gz|line 2",
          before=of_pykeen(numeric_triples=packed("head\trelation\ttail", "0\t0\t9"))),
]  # fmt: skip

PICKLE_CASES = [
    Typed("no pickle", "import theirs --trust-pickle --out out", "theirs/trained_model.pkl", before=of_pykeen()),
    Typed("a pickle alone, which nobody has said to trust", THEIRS, "theirs", before=with_pickle(b"")),
    Typed("a pickle that is none", "import theirs --trust-pickle --out out", "theirs/trained_model.pkl",
          before=with_pickle(b"a photograph"), needs="pykeen"),
    Typed("a pickle of something else", "import theirs --trust-pickle --out out",
          "theirs/trained_model.pkl|NoneType", before=with_pickle(None), needs="pykeen"),
    Typed("a model without a closed form", "import theirs --trust-pickle --out out", "theirs/trained_model.pkl",
          before=of_rescal, needs="pykeen"),
]  # fmt: skip

IMPORT_CASES = [*TYPED_CASES, *TENSOR_CASES, *NAME_CASES, *PICKLE_CASES]
