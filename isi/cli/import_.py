"""Keep an embedding that another tool has trained, so that every command can insert into it and ask it."""

from __future__ import annotations

import argparse
import re
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from isi.cli._embedding import out_folder, refuse_to_lose
from isi.errors import InputError

if TYPE_CHECKING:
    from isi.bundle.importer import Named
    from isi.bundle.manifest import Bundle


FAMILIES = ("analogy", "complex", "distmult", "rotate", "transe", "transe_l1")
PICKLE = "trained_model.pkl"


def configure(parser: argparse.ArgumentParser) -> None:
    """Its arguments."""
    parser.add_argument(
        "folder", metavar="FOLDER", type=Path,
        help="PyKEEN's (with training_triples), OpenKE's (with entity2id.txt, relation2id.txt and train2id.txt), or one"
        " with entities.txt, relations.txt (a name a line) and triples.tsv (names; may be missing)",
    )  # fmt: skip
    parser.add_argument("--out", metavar="DIR", type=out_folder, required=True, help="folder to write")
    parser.add_argument("--family", choices=FAMILIES, help="how a triple is scored; a pickle says so itself")
    parser.add_argument(
        "--set", metavar="KEY=VALUE", action="append", default=[], type=_setting,
        help="of distances: margin=NUMBER (else read off the triples), squared=true",
    )  # fmt: skip
    parser.add_argument(
        "--tensors", metavar="FILE", type=Path, nargs="+", default=[],
        help=".npy, .npz, .safetensors, .json, or a state dict as .pt or .pth; else those in FOLDER",
    )  # fmt: skip
    parser.add_argument(
        "--trust-pickle", action="store_true",
        help=f"read PyKEEN's {PICKLE}, which is a pickle: whoever wrote it can have it run any program on this machine"
        " when it is read; only for files of yours or of people you trust",
    )  # fmt: skip


def _setting(text: str) -> tuple[str, float | bool]:
    """Key and value of ``KEY=VALUE``."""
    key, found, value = text.partition("=")
    if found and value in ("true", "false"):
        return key, value == "true"
    if found and re.fullmatch(r"[0-9]+(\.[0-9]+)?(e-?[0-9]+)?", value):
        return key, float(value)
    raise argparse.ArgumentTypeError(f"expected KEY=NUMBER, KEY=true or KEY=false, got {text[:40]!r}")


def run(arguments: argparse.Namespace) -> None:
    """Read, check, and write.

    Raises:
        InputError: where something is missing, broken, or does not fit together.
    """
    from isi.bundle.folder import write
    from isi.bundle.query import check_numbers

    if arguments.trust_pickle and (arguments.family or arguments.set or arguments.tensors):
        raise InputError("--trust-pickle", "", "expected no --family, --set or --tensors: the pickle says it all")
    named, form = _names(arguments.folder)
    pickled = arguments.folder / PICKLE
    found = _of_pickle(pickled, named) if arguments.trust_pickle else _of_tensors(arguments, named, form)
    check_numbers(arguments.folder, found)
    refuse_to_lose(arguments.out, found.entity_names)
    write(arguments.out, found)
    about = found.about
    options = ", ".join(f"{key} {value}" for key, value in about.family_options.items())
    print(
        f"{len(found.entities):,} entities, {len(found.relations):,} relations, {len(found.triples):,} triples;"
        f" {about.family}{f' ({options})' if options else ''} of dimension {found.entities.shape[1]}: {arguments.out}"
    )


def _names(folder: Path) -> tuple[Named, str]:
    """Names and triples, and the form of the folder."""
    from isi.bundle import importer

    if (folder / importer.PYKEEN).is_dir():
        return importer.of_pykeen(folder / importer.PYKEEN), "PyKEEN"
    if (folder / importer.ENTITY2ID).exists():
        return importer.of_openke(folder), "entity2id"
    if (folder / importer.ENTITY_NAMES).exists():
        triples = folder / importer.TRIPLES
        lists = folder / importer.ENTITY_NAMES, folder / importer.RELATION_NAMES
        return importer.of_lists(*lists, triples if triples.exists() else None), "arrays"
    expected = f"expected a folder with {importer.PYKEEN}, {importer.ENTITY2ID} or {importer.ENTITY_NAMES}"
    raise InputError(folder, "", expected)


def _of_tensors(arguments: argparse.Namespace, named: Named, form: str) -> Bundle:
    from isi.bundle.import_tensors import read_tensors
    from isi.bundle.importer import Origin, of_tensors

    files = arguments.tensors or _tensors_in(arguments.folder, form)
    if arguments.family is None:
        raise InputError("--family", "", f"expected how a triple is scored: {', '.join(FAMILIES)}")
    tensors = {name: values for file in files for name, values in read_tensors(file).items()}
    return of_tensors(tensors, named, arguments.family, dict(arguments.set), Origin(form, files))


def _tensors_in(folder: Path, form: str) -> Sequence[Path]:
    """The files of tensors in a folder.

    Raises:
        InputError: where there are none.
    """
    from isi.bundle.import_tensors import SUFFIXES

    beside = ("results.json", "metadata.json") if form == "PyKEEN" else ()
    found = sorted(path for path in folder.iterdir() if path.suffix in SUFFIXES and path.name not in beside)
    if not found and (folder / PICKLE).exists():
        expected = (
            f"expected tensors: {PICKLE} is a pickle, which is read with --trust-pickle alone (see --help);"
            " or torch.save(model.state_dict(), FILE), which --tensors FILE reads"
        )
        raise InputError(folder, "", expected)
    if not found:
        raise InputError(folder, "", f"expected a file of tensors ({', '.join(SUFFIXES)}), or --tensors FILE")
    return found


def _of_pickle(path: Path, named: Named) -> Bundle:
    """PyKEEN's model, unpickled."""
    if not path.is_file():
        raise InputError(path, "", "expected PyKEEN's pickle of a model, but there is no such file")
    try:
        from isi.pykeen.models import read_model
    except ImportError as error:
        raise InputError(path, "", "needs PyKEEN to be read: pip install pykeen") from error
    import torch

    from isi.bundle.importer import Origin, of_pykeen_model

    try:
        model = torch.load(path, map_location="cpu", weights_only=False)  # as its user has asked for
    except Exception as error:  # whatever a pickle does
        raise InputError(path, "", f"expected a model of PyKEEN's ({type(error).__name__})") from error
    try:
        embedding = read_model(model, torch.from_numpy(named.triples), None)
    except InputError as error:
        raise InputError(path, *error.args[1:]) from error
    return of_pykeen_model(embedding, named, Origin("PyKEEN", [path]))
