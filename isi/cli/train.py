"""``isi train``: trains a bundle on your own triples, scenes or houses."""

import shlex
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from isi.cli import FROM_ONE, FROM_ZERO, NewFolder, Settings, flags, lines, settings
from isi.cli.output import paths_in, refuse_inputs


def train(
    files: Annotated[
        tuple[str, ...],
        Parameter(
            name="FILE", required=True, help="triples, scenes or houses; ROOM=FILE: in a room"
        ),
    ] = (),
    /,
    *,
    out: NewFolder,
    entities: Annotated[
        Path | None,
        Parameter(
            name=["--entities", "--kinds"],
            help="table with the column entity, and kind or phrase or both",
        ),
    ] = None,
    model: Annotated[str | None, Parameter(help="default: the best for validation triples")] = None,
    learning_rate: Annotated[
        float | None, Parameter(help="of Adagrad; default: as --model")
    ] = None,
    dimension: Annotated[
        int, Parameter(validator=FROM_ONE, help="numbers in an entity's vector")
    ] = 100,
    budget: Annotated[
        float, Parameter(help="seconds for comparing models, by an estimate of the work")
    ] = 60,
    seed: Annotated[int, Parameter(validator=FROM_ZERO, help="seed of everything random")] = 0,
    reader: Annotated[
        str | None, Parameter(help="name of a reader; default: guessed from the file")
    ] = None,
    set: Annotated[Settings, Parameter(help="KEY=VALUE: a setting of the reader")] = (),
    min_count: Annotated[
        int, Parameter(validator=FROM_ONE, help="drop triples with fewer observations")
    ] = 1,
) -> None:
    """Read files as ``isi graph`` does, train an embedding of their graph, and write a bundle."""
    import torch

    from isi.graph.files import path_of, read_graph
    from isi.live.folder import write
    from isi.live.train import described, train_bundle

    torch.set_num_threads(1)  # so that equal commands write equal bytes
    of_reader = settings(set)
    refuse_inputs([out], [*map(path_of, files), *filter(None, [entities]), *paths_in(of_reader)])
    tables, read = read_graph(files, reader, of_reader, min_count, seed)
    note = ""
    if entities:
        tables, note = described(tables, entities)
    options = {
        "model": model,
        "learning_rate": learning_rate,
        "dimension": dimension,
        "budget": budget,
    }
    with flags(**{name: f"--{name.replace('_', '-')}" for name in options}):
        bundle, summary = train_bundle(tables, **options, seed=seed)  # type: ignore[arg-type]
    write(out, bundle)
    print(*lines(read, are_names=True), sep="\n")
    if note:
        print(f"Warning: {entities}: {note}.")
    print(summary)
    head, relation, tail = map(shlex.quote, bundle.named_triples()[0])
    folder = shlex.quote(str(out))
    print(f"The embedding is in {out}. Ask it, or insert an entity that it lacks:")
    print(f"  isi ask {head} {relation} --embedding {folder}")
    print(f"  isi insert 'NEW NAME' --fact {relation} {tail} --embedding {folder}")
