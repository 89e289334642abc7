"""Write the graph of an experiment, and what its joint model predicts, in a form that other tools read."""

from __future__ import annotations

import argparse
import re
from functools import partial
from pathlib import Path

import pandas as pd

from isi.base import params, paths
from isi.base.errors import InputError
from isi.base.tables import Provenance, atomically
from isi.exports import FORMS, Outgoing
from isi.sources._naming import fault


def configure(parser: argparse.ArgumentParser) -> None:
    """Its arguments."""
    forms = [name.replace("_", "-") for name in FORMS.names()]
    parser.add_argument("experiment", metavar="EXPERIMENT", type=_name, help="whose graph was built")
    parser.add_argument("--format", choices=forms, required=True, help="of what is written")
    parser.add_argument("--out", metavar="PATH", type=Path, required=True, help="file; of property-csv, a folder")
    per = "the N best tails that the graph lacks of each head and relation, with score and rank, by the joint model"
    parser.add_argument("--predictions", metavar="N", type=_number, default=0, help=per)
    parser.add_argument("--seed", metavar="S", type=_number, help="whose joint model predicts; else the first")
    parser.add_argument("--labels", action="store_true", help="kinds and phrases of entities in RDF, too")


def _name(text: str) -> str:
    if not re.fullmatch(r"[a-z][a-z0-9_]*", text):
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
    out = outgoing(arguments.experiment, arguments.predictions, arguments.seed, arguments.labels)
    make = FORMS.get(arguments.format.replace("-", "_"), "--format")
    files = make(out, arguments.out)
    for path, text in files.items():
        try:
            atomically(path, partial(Path.write_text, data=text, encoding="utf-8", newline=""))
        except OSError as error:
            raise InputError(path, "", f"cannot be written ({error.strerror})") from error
    more = f" and {len(out.predictions):,} predictions" * bool(arguments.predictions)
    print(f"{len(out.entities):,} entities, {len(out.triples):,} triples{more}: {', '.join(map(str, files))}")


def outgoing(experiment: str, most: int, seed: int | None, labels: bool) -> Outgoing:
    """What leaves of an experiment.

    Args:
        experiment: by its name.
        most: predictions of each head and relation.
        seed: whose joint model predicts; the first where it is null.
        labels: of entities, in RDF, too.
    """
    from isi.experiments.store import Store  # here, since it loads torch

    store = Store(experiment, Provenance("export", {}))
    entities, triples = _plain(store.entities()), _plain(store.triples())
    for path, column, names in (
        *((paths.entities(experiment), column, entities[column]) for column in ("entity", "kind", "phrase")),
        (paths.triples(experiment), "relation", triples["relation"]),
    ):
        wrong = next(filter(None, map(fault, names.unique())), None)
        if wrong:
            raise InputError(path, f"column {column!r}", wrong)
    if not most:
        return Outgoing(experiment, entities, triples, pd.DataFrame(columns=["score", "rank"]), labels)
    from isi.commands._predicting import predictions

    return Outgoing(experiment, entities, triples, predictions(store, params.read(paths.PARAMS), most, seed), labels)


def _plain(table: pd.DataFrame) -> pd.DataFrame:
    """The same with text in place of categories."""
    return table.astype(dict.fromkeys(table.select_dtypes("category").columns, str))
