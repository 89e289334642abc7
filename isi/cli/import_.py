"""``isi import``: a bundle of an embedding that another tool has trained."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import torch
from cyclopts import Parameter

from isi.bundle.folder import Bundle, write
from isi.bundle.importer import FORMS, Labels, of_pykeen_model, of_tensors, read_labels
from isi.cli.app import Settings, check_out, flags, settings
from isi.errors import InputError, at
from isi.models.model import MODELS

PICKLE = "trained_model.pkl"


def import_(
    folder: Annotated[
        Path,
        Parameter(
            help="PyKEEN's (with training_triples), OpenKE's (with entity2id.txt, relation2id.txt and train2id.txt), or"
            " one with entities.txt, relations.txt (a name a line) and triples.tsv (names; may be missing)"
        ),
    ], *,
    out: Annotated[Path, Parameter(validator=check_out, help="folder to write")],
    model: Annotated[
        str | None, Parameter(name=["--family", "--model"], help="how a triple is scored; a pickle says so itself")
    ] = None,
    set: Annotated[
        Settings, Parameter(help="of distances: margin=NUMBER (else estimated from the triples), squared=true")
    ] = (),
    tensors: Annotated[
        tuple[Path, ...],
        Parameter(
            consume_multiple=True, show_default=False,
            help=".npy, .npz, .safetensors, .json, or a state dict as .pt or .pth; by default those in FOLDER",
        ),
    ] = (),
    trust_pickle: Annotated[
        bool,
        Parameter(
            help=f"read PyKEEN's {PICKLE}, which is a pickle: whoever wrote it can have it run any program on this"
            " machine when it is read; only for files of yours or of people you trust"
        ),
    ] = False,
) -> None:  # fmt: skip
    """Read, check, and write.

    Raises:
        InputError: where something is missing, broken, or does not fit together.
    """
    if trust_pickle and (model or set or tensors):
        raise InputError("--trust-pickle", "", "expected no --family, --set or --tensors: the pickle determines them")
    labels = read_labels(folder)
    if trust_pickle:
        bundle = of_pickle(folder / PICKLE, labels)
    else:
        files = list(tensors) or tensors_in(folder, labels.form)
        if model not in MODELS.names():
            expected = f"expected how a triple is scored: {', '.join(MODELS.names())}; got {model}"
            raise InputError("--family", "", expected)
        with flags(model="--family", model_options="--set"):
            bundle = of_tensors(labels, str(model), settings(set), files)
    write(out, bundle)
    manifest = bundle.manifest
    options = ", ".join(f"{key} {value}" for key, value in manifest.model_options.items())
    print(
        f"{len(bundle.entities):,} entities, {len(bundle.relations):,} relations, {len(bundle.triples):,} triples;"
        f" {manifest.model_name}{f' ({options})' if options else ''} of dimension {bundle.entities.shape[1]}: {out}"
    )


def tensors_in(folder: Path, form: str) -> list[Path]:
    """The files of tensors in a folder.

    Raises:
        InputError: where there are none.
    """
    others = ("results.json", "metadata.json") if form == "PyKEEN" else ()
    files = sorted(path for path in folder.iterdir() if path.suffix in FORMS and path.name not in others)
    if not files:
        pickled = f" ({PICKLE} is a pickle, which is read with --trust-pickle alone)" * (folder / PICKLE).exists()
        raise InputError(folder, "", f"expected a file of tensors{pickled}: {', '.join(FORMS)}, or --tensors FILE")
    return files


def of_pickle(path: Path, labels: Labels) -> Bundle:
    """A bundle of PyKEEN's model, unpickled."""
    if not path.is_file():
        raise InputError(path, "", "no such file: expected PyKEEN's pickle of a model")
    try:
        from isi.pykeen import read_model
    except ImportError as error:
        raise InputError(path, "", "needs PyKEEN to be read: pip install pykeen") from error
    try:
        model = torch.load(path, map_location="cpu", weights_only=False)  # as its user has asked for
    except Exception as error:  # whatever a pickle does
        raise InputError(path, "", f"expected a model of PyKEEN's ({type(error).__name__})") from error
    with at(path), flags(model=path):
        return of_pykeen_model(read_model(model, torch.from_numpy(labels.triples), None), labels, path)
