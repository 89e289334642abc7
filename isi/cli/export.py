"""``isi export``: a graph, of an experiment or of a bundle, and what a model predicts beyond it, for other tools."""

from __future__ import annotations

import re
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from cyclopts import Parameter

from isi import config
from isi.cli.app import FROM_ZERO
from isi.errors import InputError, meant
from isi.tables import paths

if TYPE_CHECKING:
    import pandas as pd

    from isi.cli.export_formats import GraphExport

#: Of an experiment.
NAME = re.compile(r"[a-z][a-z0-9_]*")
FORMS = Literal["graphml", "jsonld", "property-csv", "pykeen-tsv", "turtle"]


def _check_name(_: object, name: str | None) -> None:
    if name is not None and not NAME.fullmatch(name):
        raise ValueError("expected a name of lower-case letters, digits and _")


def export(
    experiment: Annotated[
        str | None, Parameter(validator=_check_name, help="whose graph was built, or a graph of the second pipeline")
    ] = None, *,
    format: Annotated[FORMS, Parameter(help="of what is written")],
    out: Annotated[Path, Parameter(help="file to write; of property-csv, a folder")],
    embedding: Annotated[Path | None, Parameter(help="folder of a bundle, in place of an experiment")] = None,
    predictions: Annotated[
        int, Parameter(validator=FROM_ZERO, help="the best tails for each head and relation, without known triples")
    ] = 0,
    seed: Annotated[
        int | None, Parameter(validator=FROM_ZERO, help="whose joint model predicts; by default the first")
    ] = None,
    labels: Annotated[bool, Parameter(help="kinds and phrases of entities in RDF, too")] = False,
) -> None:  # fmt: skip
    """Read the graph, predict, and write.

    Raises:
        InputError: where the experiment has no graph, or no joint model of this graph, or the output cannot be written.
    """
    from isi.cli.export_formats import FORMATS
    from isi.tables.io import atomically

    if out.suffix == ".gz":
        raise InputError(out, "", "expected another name: the output is not compressed")
    if embedding is not None and experiment is None:
        if seed is not None:
            raise InputError("--seed", "", "expected an experiment, which has a model for each seed")
        exported = of_bundle(embedding, predictions, labels)
    elif experiment is not None and embedding is None:
        exported = of_experiment(experiment, predictions, seed, labels)
    else:
        raise InputError("", "", "expected either EXPERIMENT or --embedding DIR")
    files = FORMATS[format](exported, out)
    for path, text in files.items():
        try:
            if text is None:
                path.unlink(missing_ok=True)
            else:
                atomically(path, partial(Path.write_text, data=text, encoding="utf-8", newline=""))
        except OSError as error:
            raise InputError(path, "", f"cannot be written ({error.strerror})") from error
    more = f" and {len(exported.predictions):,} predictions" * bool(predictions)
    written = ", ".join(str(path) for path, text in files.items() if text is not None)
    print(f"{len(exported.entities):,} entities, {len(exported.triples):,} triples{more}: {written}")


def of_experiment(experiment: str, most: int, seed: int | None, labels: bool) -> GraphExport:
    """The graph of an experiment, and predictions of its joint model.

    Args:
        most: predictions for each head and relation.
        seed: whose joint model predicts; the first where it is null.
        labels: of entities, in RDF, too.
    """
    from isi.cli.export_formats import GraphExport
    from isi.cli.predictions import NO_PREDICTIONS, by_joint_model
    from isi.experiment.store import Store
    from isi.graph.graph import ENTITIES, TRIPLES
    from isi.tables.table import as_text

    files, has_model = _files(experiment)
    if most and not has_model:
        expected = "expected an experiment of params.yaml: graphs of the second pipeline have no model"
        raise InputError("--predictions", experiment, expected)
    entities, triples = as_text(ENTITIES.read_file(files[0])), as_text(TRIPLES.read_file(files[1]))
    _check_names(files, entities, triples)
    predictions = NO_PREDICTIONS
    if most:
        predictions = by_joint_model(Store(experiment), config.read(paths.PARAMS), most, seed)
    return GraphExport(experiment, entities, triples, predictions, labels)


def of_bundle(folder: Path, most: int, labels: bool) -> GraphExport:
    """The known triples of a bundle, each with count 1, and predictions of its model. See ``of_experiment``."""
    import pandas as pd

    from isi.cli.entity import open_folder
    from isi.cli.export_formats import TRIPLE, GraphExport
    from isi.cli.predictions import NO_PREDICTIONS, by_bundle
    from isi.sources.names import ENTITY

    opened = open_folder(folder)
    bundle, name = opened.bundle, folder.resolve().name
    entities = pd.DataFrame({"entity": bundle.entity_names, "kind": bundle.kinds, "phrase": bundle.phrases})
    entities["kind"] = entities["kind"].replace("", ENTITY)
    entities["phrase"] = entities["phrase"].where(entities["phrase"] != "", entities["entity"])
    names_by_slot = bundle.entity_names, bundle.relation_names, bundle.entity_names
    columns = zip(TRIPLE, names_by_slot, bundle.triples.T.tolist(), strict=True)
    triples = pd.DataFrame({column: [names[row] for row in ids] for column, names, ids in columns}).assign(count=1)
    _check_names((folder / "entities.tsv", folder / "triples.tsv"), entities, triples)
    predictions = by_bundle(opened, entities["kind"], most) if most else NO_PREDICTIONS
    return GraphExport(name if NAME.fullmatch(name) else "embedding", entities, triples, predictions, labels)


def _check_names(files: tuple[Path, Path], entities: pd.DataFrame, triples: pd.DataFrame) -> None:
    """Refuse names that other tools would not read.

    Raises:
        InputError: naming the file and the column.
    """
    from isi.sources.names import name_fault

    columns = [(files[0], entities[column]) for column in ("entity", "kind", "phrase")]
    for path, names in [*columns, (files[1], triples["relation"])]:
        if wrong := next(filter(None, map(name_fault, names.unique())), None):
            raise InputError(path, f"column {names.name!r}", wrong)


def _files(experiment: str) -> tuple[tuple[Path, Path], bool]:
    """Entities and triples of an experiment, or of a graph of the second pipeline, and whether it is the former."""
    from isi.graph.graph import ENTITIES, GRAPH_ENTITIES, GRAPH_TRIPLES, TRIPLES

    first = ENTITIES.path(experiment=experiment), TRIPLES.path(experiment=experiment)
    second = GRAPH_ENTITIES.path(graph=experiment), GRAPH_TRIPLES.path(graph=experiment)
    if first[0].exists() or second[0].exists():
        return (first, True) if first[0].exists() else (second, False)
    experiments, graphs = _keys(paths.PARAMS, "experiments"), _keys(paths.BEYOND_PARAMS, "graphs")
    if experiment not in (known := [*experiments, *graphs]):
        expected = f"expected one of {', '.join(known)}, got {experiment[:80]!r}{meant(experiment, known)}"
        raise InputError("EXPERIMENT", "", expected)
    return (first, True) if experiment in experiments else (second, False)


def _keys(path: Path, key: str) -> list[str]:
    """Names under a key of params."""
    values = config.read(path).get(key)
    return list(values) if isinstance(values, dict) else []
