"""``isi import``: a bundle of an embedding that another tool has trained."""

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from isi.bundle.folder import write
from isi.bundle.importer import PICKLE, of_pickle, of_tensors, read_labels, tensors_in
from isi.cli import NewFolder, Settings, flags, settings
from isi.errors import InputError
from isi.models.model import MODELS


def import_(
    folder: Annotated[Path, Parameter(
        help="PyKEEN's (with training_triples), OpenKE's (with entity2id.txt, relation2id.txt and train2id.txt), or"
        " one with entities.txt, relations.txt (a name a line) and triples.tsv (names; may be missing)")], *,
    out: NewFolder,
    model: Annotated[str | None, Parameter(
        name=["--family", "--model"], help="how a triple is scored; a pickle says so itself")] = None,
    set: Annotated[Settings, Parameter(
        help="of distances: margin=NUMBER (else estimated from the triples), squared=true")] = (),
    tensors: Annotated[tuple[Path, ...], Parameter(
        consume_multiple=True, show_default=False,
        help=".npy, .npz, .safetensors, .json, or a state dict as .pt or .pth; by default those in FOLDER")] = (),
    trust_pickle: Annotated[bool, Parameter(
        help=f"read PyKEEN's {PICKLE}, which is a pickle: whoever wrote it can have it run any program on this"
        " machine when it is read; only for files of yours or of people you trust")] = False,
) -> None:  # fmt: skip
    """Read, check, and write. An ``InputError`` names what is missing, broken, or does not fit."""
    if trust_pickle and (model or set or tensors):
        raise InputError("--trust-pickle", "", "expected no --family, --set or --tensors: the pickle determines them")
    labels = read_labels(folder)
    if trust_pickle:
        with flags(model=folder / PICKLE):
            bundle = of_pickle(folder / PICKLE, labels)
    else:
        files = list(tensors) or tensors_in(folder, labels.form)
        if model not in MODELS.names():
            expected = f"expected how a triple is scored: {', '.join(MODELS.names())}; got {model}"
            raise InputError("--family", "", expected)
        with flags(model="--family", model_options="--set"):
            bundle = of_tensors(labels, str(model), settings(set), files)
    write(out, bundle)
    options, size = ", ".join(f"{key} {value}" for key, value in bundle.manifest.model_options.items()), bundle.sizes()
    print(
        f"{size['entities']:,} entities, {size['relations']:,} relations, {size['triples']:,} triples;"
        f" {bundle.manifest.model_name}{f' ({options})' * bool(options)} of dimension {size['dimension']}: {out}"
    )
