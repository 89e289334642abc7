"""``isi import``: a bundle of an embedding that another tool has trained."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Parameter

from isi.cli.app import Settings, check_out, flags, settings
from isi.errors import InputError

if TYPE_CHECKING:
    from isi.bundle.importer import Labels
    from isi.bundle.manifest import Bundle

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
    from isi.bundle.folder import write
    from isi.bundle.importer import read_labels
    from isi.bundle.query import check_numbers
    from isi.cli.entity import refuse_to_lose

    if trust_pickle and (model or set or tensors):
        raise InputError("--trust-pickle", "", "expected no --family, --set or --tensors: the pickle determines them")
    labels = read_labels(folder)
    if trust_pickle:
        bundle = _of_pickle(folder / PICKLE, labels)
    else:
        bundle = _of_tensors(list(tensors) or _tensors_in(folder, labels.form), labels, model, settings(set))
    check_numbers(folder, bundle)
    refuse_to_lose(out, bundle.entity_names)
    write(out, bundle)
    manifest = bundle.manifest
    options = ", ".join(f"{key} {value}" for key, value in manifest.model_options.items())
    print(
        f"{len(bundle.entities):,} entities, {len(bundle.relations):,} relations, {len(bundle.triples):,} triples;"
        f" {manifest.model_name}{f' ({options})' if options else ''} of dimension {bundle.entities.shape[1]}: {out}"
    )


def _of_tensors(files: Sequence[Path], labels: Labels, model: str | None, options: dict[str, Any]) -> Bundle:
    from isi.bundle.import_tensors import read_tensors
    from isi.bundle.importer import of_tensors
    from isi.models.model import MODELS

    if model not in MODELS.names():
        raise InputError("--family", "", f"expected how a triple is scored: {', '.join(MODELS.names())}; got {model}")
    tensors = {name: values for file in files for name, values in read_tensors(file).items()}
    with flags(model="--family", model_options="--set", entities=files[0], relations=files[0]):
        return of_tensors(tensors, labels, model, options, files)


def _tensors_in(folder: Path, form: str) -> Sequence[Path]:
    """The files of tensors in a folder.

    Raises:
        InputError: where there are none.
    """
    from isi.bundle.import_tensors import FORMS

    others = ("results.json", "metadata.json") if form == "PyKEEN" else ()
    files = sorted(path for path in folder.iterdir() if path.suffix in FORMS and path.name not in others)
    if not files and (folder / PICKLE).exists():
        expected = (
            f"expected tensors: {PICKLE} is a pickle, which is read with --trust-pickle alone (see --help);"
            " or torch.save(model.state_dict(), FILE), which --tensors FILE reads"
        )
        raise InputError(folder, "", expected)
    if not files:
        raise InputError(folder, "", f"expected a file of tensors ({', '.join(FORMS)}), or --tensors FILE")
    return files


def _of_pickle(path: Path, labels: Labels) -> Bundle:
    """A bundle of PyKEEN's model, unpickled."""
    if not path.is_file():
        raise InputError(path, "", "no such file: expected PyKEEN's pickle of a model")
    try:
        from isi.pykeen.models import read_model
    except ImportError as error:
        raise InputError(path, "", "needs PyKEEN to be read: pip install pykeen") from error
    import torch

    from isi.bundle.importer import of_pykeen_model

    try:
        model = torch.load(path, map_location="cpu", weights_only=False)  # as its user has asked for
    except Exception as error:  # whatever a pickle does
        raise InputError(path, "", f"expected a model of PyKEEN's ({type(error).__name__})") from error
    try:
        embedding = read_model(model, torch.from_numpy(labels.triples), None)
    except InputError as error:
        raise InputError(path, *error.args[1:]) from error
    with flags(model=path, entities=path, relations=path):
        return of_pykeen_model(embedding, labels, path)
