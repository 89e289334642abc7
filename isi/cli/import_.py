"""``isi import``: makes a home of an embedding that another tool, or the pipeline, has trained."""

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from isi.cli import NewFolder, Settings, flags, settings
from isi.cli.output import refuse_inputs
from isi.errors import InputError, at
from isi.live.bundle import MANIFEST, Bundle, read
from isi.live.checkpoints import checkpoint_reader
from isi.live.home import Home, check_free
from isi.live.importer import PICKLE, of_tables, read_labels, read_tables, tensors_in
from isi.live.phrases import with_words
from isi.models.losses import Loss
from isi.models.model import MODELS


def import_(
    folder: Annotated[
        Path,
        Parameter(
            help=(
                "folder of PyKEEN (training_triples), of OpenKE (entity2id.txt, relation2id.txt,"
                " optional train2id.txt), of PyTorch-BigGraph (checkpoint_version.txt, with the"
                " names of its preprocessing), of dicee (configuration.json), of the pipeline"
                " (embedding.json), or with entities.txt,"
                " relations.txt (one name per line) and optional triples.tsv (names)"
            )
        ),
    ],
    *,
    out: NewFolder,
    model: Annotated[
        str | None,
        Parameter(
            help="scoring function, unless FOLDER or --trust-pickle determines it",
        ),
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
    vectors: Annotated[
        Path | None, Parameter(help="word2vec or GloVe file, for the word vectors of names")
    ] = None,
    tensors: Annotated[
        tuple[Path, ...],
        Parameter(
            consume_multiple=True,
            show_default=False,
            help=(
                ".npy, .npz, .safetensors, or a state dict as .pt, .pth or .ckpt; default: "
                "those in FOLDER"
            ),
        ),
    ] = (),
    entities: Annotated[
        str | None,
        Parameter(help="name of the tensor of entities; default: the one with a row for each"),
    ] = None,
    relations: Annotated[
        str | None,
        Parameter(help="name of the tensor of relations; default: the one with a row for each"),
    ] = None,
    trust_pickle: Annotated[
        bool,
        Parameter(
            help=(
                f"read PyKEEN's {PICKLE}: whoever wrote a pickle can have it run any program on"
                " this machine, so use this only for files of your own or of people you trust"
            )
        ),
    ] = False,
) -> None:
    """Read an embedding, check it, and make it a home.
    An ``InputError`` names the missing or wrong file or tensor.
    """
    refuse_inputs([out], [folder, *tensors])
    check_free(out)
    names = {"entities": entities, "relations": relations}
    chosen = tensors or any(names.values())
    if trust_pickle and (model or set or chosen or loss):
        raise InputError(
            "--trust-pickle",
            "",
            "expected no --model, --set, --loss or names of tensors: the pickle determines them",
        )
    bundle: Bundle
    if (folder / MANIFEST).is_file():
        if trust_pickle or model or chosen or set or loss:
            raise InputError(folder, "", "expected no option but --vectors: it says what it holds")
        bundle = read(folder)
    elif reader := checkpoint_reader(folder):
        if trust_pickle or model or chosen:
            expected = (
                "expected no --model, --trust-pickle or names of tensors: it says which model it "
                "holds"
            )
            raise InputError(folder, "", expected)
        with flags(model=folder, model_options="--set"):
            bundle = reader(folder, settings(set), loss)
    elif trust_pickle:
        labels, pickled = read_labels(folder), folder / PICKLE
        if not pickled.is_file():
            raise InputError(pickled, "", "no such file: expected PyKEEN's pickle of a model")
        with at(pickled):
            from isi.pykeen.pickled import of_pickle  # here, since only pickles need PyKEEN
        with flags(model=pickled):
            bundle = of_pickle(pickled, labels)
    else:
        labels = read_labels(folder)
        files = list(tensors) or tensors_in(folder, labels.form)
        if model not in MODELS.names():
            expected = f"expected a model among {', '.join(MODELS.names())}; got {model}"
            raise InputError("--model", "", expected)
        with flags(model="--model", model_options="--set"):
            tables = read_tables(files, str(model), labels, names)
            bundle = of_tables(labels, str(model), settings(set), tables, files, loss)
    bundle = with_words(bundle, vectors)
    Home.create(bundle, out).close()
    options = ", ".join(f"{key} {value}" for key, value in bundle.manifest.model_options.items())
    size = bundle.sizes()
    print(
        f"{size['entities']:,} entities, {size['relations']:,} relations, {size['triples']:,}"
        f" triples; {bundle.manifest.model_name}{f' ({options})' * bool(options)} of"
        f" dimension {size['dimension']}: {out}"
    )
