"""Say which entities have the nearest vectors."""

from __future__ import annotations

import argparse

from isi.cli import _embedding as shared


def configure(parser: argparse.ArgumentParser) -> None:
    """Its arguments."""
    parser.add_argument("entity", metavar="ENTITY", help="whose neighbours are asked for")
    shared.add_arguments(parser, top=10)


def run(arguments: argparse.Namespace) -> None:
    """Compare its vector with the others'.

    Raises:
        InputError: where the embedding is broken, or the entity is unknown.
    """
    model = shared.open_folder(arguments.embedding)
    entity = model.entity(arguments.entity, "ENTITY")
    names, kinds = model.kept.entity_names, model.kept.kinds
    found = [
        {"entity": names[other], "kind": kinds[other] or None, "cosine": cosine}
        for other, cosine in model.nearest(entity, arguments.top)
    ]
    if arguments.json:
        print(shared.as_json({"entity": names[entity], "nearest": found}))
        return
    print(f"{names[entity]} (cosine of the vectors)")
    rows = [(f"{one['cosine']:.3f}", str(one["entity"]), str(one["kind"] or "")) for one in found]
    print(*shared.columns(rows), sep="\n")
