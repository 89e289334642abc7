"""Say why an inserted entity lies where it does: what it went by, and where it would lie without each of that."""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any

from isi.cli import _embedding as shared
from isi.errors import InputError

if TYPE_CHECKING:
    from isi.bundle.explain import Without
    from isi.bundle.indicators import Indicator
    from isi.bundle.manifest import InsertionRecord
    from isi.bundle.query import OpenBundle


#: What was left out, as it is said.
LEFT_OUT = {"fact": "the triple {}", "words": "the words of {!r}", "indicator": "the indicator {}"}


def configure(parser: argparse.ArgumentParser) -> None:
    """Its arguments."""
    parser.add_argument("entity", metavar="ENTITY", help="that isi insert --out put into this embedding")
    shared.add_arguments(parser)


def run(arguments: argparse.Namespace) -> None:
    """Insert it again, and without each of what it went by.

    Raises:
        InputError: where the embedding is broken, or the entity was not inserted into it.
    """
    import numpy as np
    from tqdm import tqdm

    model = shared.open_folder(arguments.embedding)
    from isi.bundle.answers import worth_asking
    from isi.bundle.explain import again, each_left_out
    from isi.bundle.folder import ABOUT

    entity = model.entity(arguments.entity, "ENTITY")
    name = model.kept.entity_names[entity]
    record = model.kept.inserted().get(name)
    if record is None:
        there = ", ".join(model.kept.inserted()) or "none"
        raise InputError(arguments.embedding, "", f"expected an entity that was inserted ({there}), got {name!r:.80}")
    with shared.as_option({"argument 'initializer'": f"{arguments.embedding / ABOUT}: inserted: {name}"}):
        placed = again(model, record)
        shown = placed.indicators()
        weights = {one.entity: one.weight or 1.0 for one in shown}
        questions = worth_asking(model, entity, weights)
        chosen = [one for one in shown if one.weight is not None]
        number = len(record.told) + len(chosen) + 1
        each = each_left_out(model, record, chosen, questions, arguments.top)
        without = list(tqdm(each, "left out", number, leave=False, disable=None))
    if arguments.json:
        print(shared.as_json(_as_json(model, record, shown, without)))
    else:
        print(*_lines(model, record, shown, without, arguments.top), sep="\n")
        if not np.allclose(placed.vector, model.kept.entities[entity], rtol=1e-3, atol=1e-6):
            print("note: its vector is not the one that was inserted: it was trained since, or the words are others")


def _lines(
    model: OpenBundle, record: InsertionRecord, shown: Sequence[Indicator], without: Sequence[Without], top: int
) -> Iterator[str]:
    yield f"{record.entity}: inserted by {record.initializer} ({record.why})"
    yield from (f"  told: {' '.join(fact)}" for fact in record.told)
    if record.definition:
        yield f"  definition: {record.definition}"
    yield from shared.indicator_lines(model, shown)
    yield f"without each of these (moved: in lengths of its vector; answers: the best {top} of each question)"
    for one in without:
        yield from _said(model, record, one)


def _said(model: OpenBundle, record: InsertionRecord, one: Without) -> Iterator[str]:
    """What would be without one thing."""
    what = LEFT_OUT[one.left_out].format(one.what)
    if one.moved is None:
        yield f"  {what}: nothing would be known of it"
        return
    other = f", by {one.initializer}" * (one.initializer != record.initializer)
    yield f"  {what}: moved {one.moved:.2f}, cosine {one.cosine:.2f}{other}"
    for change in one.changes:
        question = " ".join(shared.asked(model, change.question))
        yield f"    {question}  {', '.join(change.come)} in place of {', '.join(change.gone)}"


def _as_json(
    model: OpenBundle, record: InsertionRecord, shown: Sequence[Indicator], without: Sequence[Without]
) -> dict[str, Any]:  # fmt: skip
    return {
        **record.model_dump(),
        "indicators": [shared.indicator_json(model, one) for one in shown],
        "without": [
            {
                "left_out": one.left_out, "what": one.what, "initializer": one.initializer, "cosine": one.cosine,
                "moved": one.moved,
                "changes": [
                    {"question": list(shared.asked(model, change.question)), "gone": change.gone, "come": change.come}
                    for change in one.changes
                ],
            }
            for one in without
        ],
    }  # fmt: skip
