"""``isi train``: trains a home on your own triples or scenes, or a home again."""

from __future__ import annotations

import shlex
from collections import Counter
from collections.abc import Sequence
from contextlib import AbstractContextManager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Parameter

from isi.cli import HOME, NewFolder, Settings, flags, lines, settings, show
from isi.cli.options import command_of
from isi.cli.overwriting import paths_in, refuse_inputs
from isi.errors import InputError
from isi.home import verbs

if TYPE_CHECKING:
    from isi.graph.graph import GraphTables


@command_of
def train(
    verb: verbs.Train,
    files: Annotated[
        tuple[str, ...],
        Parameter(
            name="FILE",
            required=True,
            help="triples or scenes (ROOM=FILE: in a room), or a home",
        ),
    ] = (),
    /,
    *,
    out: NewFolder | None = None,
    entities: Annotated[
        Path | None,
        Parameter(
            name=["--entities", "--kinds"],
            help="table with the column entity, and kind or phrase or both",
        ),
    ] = None,
    reader: Annotated[
        str | None, Parameter(help="name of a reader; default: by the suffix")
    ] = None,
    set: Annotated[Settings, Parameter(help="KEY=VALUE: a setting of the reader")] = (),
    describe: Annotated[
        bool, Parameter(help="only read the files, and print what their graph has")
    ] = False,
) -> None:
    """Read files, train an embedding of their graph, and make it a home.
    FILE may be a home: it is trained again on all that holds.
    """
    from isi.graph.files import path_of, read_graph
    from isi.home.folder import check_free, is_home

    home = next((Path(file) for file in files if is_home(Path(file))), None)
    if home is not None:
        if len(files) > 1 or out or entities or reader or set or describe:
            expected = "expected no other FILE and no option of files: a home is trained as it is"
            raise InputError(home, "", expected)
        _train_again(home, verb)
        return
    if out is None and not describe:
        raise InputError("--out", "", "expected a folder for the home")
    of_reader = settings(set)
    if out is not None:
        inputs = [*map(path_of, files), *filter(None, [entities]), *paths_in(of_reader)]
        refuse_inputs([out], inputs)
        check_free(out)
    tables, read = read_graph(files, reader, of_reader, verb.seed)
    note = ""
    if entities:
        from isi.home.train import described  # needs PyTorch, which takes long to load

        tables, note = described(tables, entities)
    of_files = [*lines(read, are_names=True), *([f"Warning: {entities}: {note}."] if note else [])]
    if out is None or describe:
        print(*of_files, sep="\n")
        show(counts(tables))
        return
    _train(tables, out, verb, of_files)


def _train_again(folder: Path, verb: verbs.Train) -> None:
    """Train a home again."""
    from isi.home.home import open_home

    _use_one_thread()
    with open_home(folder) as home, _flags():
        print(verb.of(home))
        home.prepare(progress=True)
    print(f"The home is trained again on all that holds: {folder}")


def _use_one_thread() -> None:
    """Compute on one thread, so that equal commands train equal vectors."""
    import torch

    torch.set_num_threads(1)


def _train(tables: GraphTables, out: Path, verb: verbs.Train, of_files: Sequence[str]) -> None:
    """Train a new home, and print how, after lines on its files."""
    from isi.home.bundle import with_functional
    from isi.home.folder import create
    from isi.home.home import Home
    from isi.home.train import train_bundle

    _use_one_thread()
    with _flags():
        bundle, summary = train_bundle(
            tables,
            verb.vectors,
            learning_rate=verb.learning_rate,
            dimension=verb.dimension,
            seed=verb.seed,
        )
        bundle = with_functional(bundle, verb.functional)
    with Home(bundle, create(bundle, out)) as home:
        home.prepare(progress=True)
    print(*of_files, summary, sep="\n")
    head, relation, tail = map(shlex.quote, bundle.named_triples()[0])
    folder = "" if out == HOME else f" --home {shlex.quote(str(out))}"
    print(f"The home is in {out}. Ask it, or tell it of something new:")
    print(f"  isi ask {head} {relation}{folder}")
    print(f"  isi tell 'NEW NAME' {relation} {tail}{folder}")


def _flags() -> AbstractContextManager[None]:
    """``flags`` of the options about the embedding."""
    names = {"learning_rate": "--learning-rate", "dimension": "--dimension"}
    return flags(**names, relation="--functional")


def counts(tables: GraphTables) -> dict[str, Any]:
    """What a graph has: entities by kind, and triples and observations by relation."""
    entities, triples = tables.entities, tables.triples
    relations = triples.astype({"relation": str}).groupby("relation")["count"].agg(["size", "sum"])
    return {
        "entities": len(entities),
        "unique_triples": len(triples),
        "observations": int(triples["count"].sum()),
        "entities_by_kind": dict(Counter(sorted(entities["kind"].astype(str))).most_common()),
        "relations": [
            {"relation": relation, "unique_triples": number, "observations": observations}
            for relation, number, observations in relations.itertuples()
        ],
    }
