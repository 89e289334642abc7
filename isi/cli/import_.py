"""``isi import``: makes a home of an embedding that another tool, or the pipeline, has trained."""

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from isi.cli import NewFolder, Settings, flags, settings
from isi.cli.overwriting import refuse_inputs
from isi.config import Option
from isi.errors import InputError
from isi.formats.plain import read
from isi.formats.tables import of_tables, read_labels, read_tables
from isi.home.bundle import MANIFEST, Bundle, with_functional
from isi.home.folder import check_free, create
from isi.home.phrases import with_words
from isi.models.losses import Loss
from isi.models.model import MODELS


def import_(
    folder: Annotated[
        Path,
        Parameter(
            help=(
                "folder with tensors entities and relations, entities.txt, relations.txt (one name"
                " per line) and optional triples.tsv (names); of PyKEEN (training_triples, and"
                " state.pt); or of the pipeline (embedding.json)"
            )
        ),
    ],
    *,
    out: NewFolder,
    model: Annotated[
        str | None, Parameter(help="scoring function, unless FOLDER is the pipeline's")
    ] = None,
    set: Annotated[
        Settings,
        Parameter(
            help=(
                "for distance models: margin=NUMBER (default: estimated from the triples), "
                "squared=true"
            )
        ),
    ] = (),
    loss: Annotated[
        Loss | None,
        Parameter(
            help=(
                "what the embedding was trained with, which says what its scores mean "
                "(default: decided on hidden entities at the first insertion)"
            )
        ),
    ] = None,
    functional: Annotated[
        tuple[str, ...], Parameter(help="relation of which a thing has one fact; may repeat")
    ] = (),
    vectors: Annotated[
        Path | None, Parameter(help="word2vec or GloVe file, for the word vectors of names")
    ] = None,
) -> None:
    """Read an embedding, check it, and make it a home.
    An ``InputError`` names the missing or wrong file or tensor.
    """
    refuse_inputs([out], [folder])
    check_free(out)
    if (folder / MANIFEST).is_file():
        if model or set or loss:
            raise InputError(folder, "", "expected no option but --vectors: it says what it holds")
        bundle = read(folder)
    else:
        bundle = _of_arrays(folder, model, settings(set), loss)
    with flags(relation="--functional"):
        bundle = with_functional(with_words(bundle, vectors), functional)
    create(bundle, out).close()
    options = ", ".join(f"{key} {value}" for key, value in bundle.manifest.model_options.items())
    size = bundle.sizes()
    print(
        f"{size['entities']:,} entities, {size['relations']:,} relations, {size['triples']:,}"
        f" triples; {bundle.manifest.model_name}{f' ({options})' * bool(options)} of"
        f" dimension {size['dimension']}: {out}"
    )


def _of_arrays(
    folder: Path, model: str | None, options: Mapping[str, Option], loss: Loss | None
) -> Bundle:
    """The bundle of a folder of tensors and names."""
    labels = read_labels(folder)
    if model not in MODELS.names():
        expected = f"expected a model among {', '.join(MODELS.names())}; got {model}"
        raise InputError("--model", "", expected)
    with flags(model="--model", model_options="--set"):
        files, tables = read_tables(folder, str(model))
        return of_tables(labels, str(model), options, tables, files, loss)
