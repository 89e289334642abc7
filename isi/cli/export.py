"""Write the graph of an experiment or of an embedding, and what a model predicts, in a form that other tools read."""

from __future__ import annotations

import argparse
import re
from functools import partial
from pathlib import Path

import pandas as pd

from isi import config
from isi.errors import InputError, meant
from isi.exports import FORMS, Outgoing
from isi.graph.tables import ENTITIES, GRAPH_ENTITIES, GRAPH_TRIPLES, TRIPLES
from isi.sources._naming import ENTITY, fault
from isi.tables import paths
from isi.tables.io import atomically
from isi.tables.table import as_text

#: Of an experiment.
NAME = re.compile(r"[a-z][a-z0-9_]*")


def configure(parser: argparse.ArgumentParser) -> None:
    """Its arguments."""
    forms = [name.replace("_", "-") for name in FORMS.names()]
    parser.add_argument(
        "experiment", metavar="EXPERIMENT", type=_name, nargs="?",
        help="whose graph was built, or a graph of the second pipeline",
    )  # fmt: skip
    embedding = "in place of an experiment, the folder of an embedding, which predicts by itself"
    parser.add_argument("--embedding", metavar="DIR", type=Path, help=embedding)
    parser.add_argument("--format", choices=forms, required=True, help="of what is written")
    parser.add_argument("--out", metavar="PATH", type=Path, required=True, help="file; of property-csv, a folder")
    per = "the N best tails that the graph lacks of each head and relation, with score and rank, by the joint model"
    parser.add_argument("--predictions", metavar="N", type=_number, default=0, help=per)
    parser.add_argument("--seed", metavar="S", type=_number, help="whose joint model predicts; else the first")
    parser.add_argument("--labels", action="store_true", help="kinds and phrases of entities in RDF, too")


def _name(text: str) -> str:
    if not NAME.fullmatch(text):
        raise argparse.ArgumentTypeError(f"expected a name of lower-case letters, digits and _, got {text[:40]!r}")
    return text


def _number(text: str) -> int:
    if not re.fullmatch(r"[0-9]{1,9}", text):
        raise argparse.ArgumentTypeError(f"expected a whole number, got {text[:40]!r}")
    return int(text)


def run(arguments: argparse.Namespace) -> None:
    """Read the graph, predict, and write.

    Raises:
        InputError: where the experiment has no graph, or no joint model of this graph, or nothing can be written there.
    """
    if (arguments.experiment is None) == (arguments.embedding is None):
        raise InputError("", "", "expected either EXPERIMENT or --embedding DIR")
    if arguments.embedding and arguments.seed is not None:
        raise InputError("--seed", "", "expected an experiment, which has a model for each seed")
    if arguments.embedding:
        out = of_folder(arguments.embedding, arguments.predictions, arguments.labels)
    else:
        out = outgoing(arguments.experiment, arguments.predictions, arguments.seed, arguments.labels)
    make = FORMS.get(arguments.format.replace("-", "_"), "--format")
    if arguments.out.suffix == ".gz":
        raise InputError(arguments.out, "", "expected another name: what is written is not compressed")
    files = make(out, arguments.out)
    for path, text in files.items():
        try:
            if text is None:
                path.unlink(missing_ok=True)
            else:
                atomically(path, partial(Path.write_text, data=text, encoding="utf-8", newline=""))
        except OSError as error:
            raise InputError(path, "", f"cannot be written ({error.strerror})") from error
    more = f" and {len(out.predictions):,} predictions" * bool(arguments.predictions)
    written = ", ".join(str(path) for path, text in files.items() if text is not None)
    print(f"{len(out.entities):,} entities, {len(out.triples):,} triples{more}: {written}")


def outgoing(experiment: str, most: int, seed: int | None, labels: bool) -> Outgoing:
    """What leaves of an experiment.

    Args:
        experiment: by its name.
        most: predictions of each head and relation.
        seed: whose joint model predicts; the first where it is null.
        labels: of entities, in RDF, too.
    """
    files, stored = _files(experiment)
    if most and not stored:
        kept = "expected an experiment of params.yaml: of a graph of the second pipeline, no model is kept"
        raise InputError("--predictions", experiment, kept)
    entities, triples = as_text(ENTITIES.read_file(files[0])), as_text(TRIPLES.read_file(files[1]))
    _check_names(files, entities, triples)
    if not most:
        return Outgoing(experiment, entities, triples, _nothing(), labels)
    from isi.cli._predicting import predictions  # here, since it loads torch
    from isi.experiment.store import Store

    store = Store(experiment)
    return Outgoing(experiment, entities, triples, predictions(store, config.read(paths.PARAMS), most, seed), labels)


def of_folder(folder: Path, most: int, labels: bool) -> Outgoing:
    """What leaves of an embedding: its known triples, each seen once. See ``outgoing``."""
    from isi.cli._embedding import open_folder

    model = open_folder(folder)
    kept, name = model.kept, folder.resolve().name
    entities = pd.DataFrame({"entity": kept.entity_names, "kind": kept.kinds, "phrase": kept.phrases})
    entities["kind"] = entities["kind"].replace("", ENTITY)
    entities["phrase"] = entities["phrase"].where(entities["phrase"] != "", entities["entity"])
    named = (kept.entity_names, kept.relation_names, kept.entity_names)
    triples = pd.DataFrame(
        {column: [names[row] for row in ids] for column, names, ids
         in zip(("head", "relation", "tail"), named, kept.triples.T.tolist(), strict=True)}
    ).assign(count=1, source=name)  # fmt: skip
    _check_names((folder / "entities.tsv", folder / "triples.tsv"), entities, triples)
    known = name if NAME.fullmatch(name) else "embedding"
    if not most:
        return Outgoing(known, entities, triples, _nothing(), labels)
    import torch

    from isi.cli._predicting import best
    from isi.graph.graph import Graph

    kinds = torch.from_numpy(pd.factorize(entities["kind"])[0].astype("int64"))
    ids, counts = torch.from_numpy(kept.triples), torch.ones(len(kept.triples), dtype=torch.int64)
    graph = Graph(kept.entity_names, kept.relation_names, ids, counts, kinds)
    everyone = torch.ones(len(kept.entities), dtype=torch.bool)
    return Outgoing(known, entities, triples, best(graph, model.embedding, everyone, most), labels)


def _nothing() -> pd.DataFrame:
    return pd.DataFrame(columns=["score", "rank"])


def _check_names(files: tuple[Path, Path], entities: pd.DataFrame, triples: pd.DataFrame) -> None:
    """Refuse names that no tool would read.

    Raises:
        InputError: naming the file and the column.
    """
    for path, column, names in (
        *((files[0], column, entities[column]) for column in ("entity", "kind", "phrase")),
        (files[1], "relation", triples["relation"]),
    ):
        wrong = next(filter(None, map(fault, names.unique())), None)
        if wrong:
            raise InputError(path, f"column {column!r}", wrong)


def _files(experiment: str) -> tuple[tuple[Path, Path], bool]:
    """Entities and triples of an experiment, or of a graph of the second pipeline, and whether it is the former."""
    own = ENTITIES.path(experiment=experiment), TRIPLES.path(experiment=experiment)
    elsewhere = GRAPH_ENTITIES.path(graph=experiment), GRAPH_TRIPLES.path(graph=experiment)
    if own[0].exists() or elsewhere[0].exists():
        return (own, True) if own[0].exists() else (elsewhere, False)
    experiments, graphs = _listed(paths.PARAMS, "experiments"), _listed(paths.BEYOND_PARAMS, "graphs")
    if experiment not in (known := [*experiments, *graphs]):
        expected = f"expected one of {', '.join(known)}, got {experiment[:80]!r}{meant(experiment, known)}"
        raise InputError("EXPERIMENT", "", expected)
    return (own, True) if experiment in experiments else (elsewhere, False)


def _listed(path: Path, key: str) -> list[str]:
    """Names under a key of params."""
    found = config.read(path).get(key)
    return list(found) if isinstance(found, dict) else []
