"""Ask an embedding: (ENTITY, RELATION, ?), or (?, RELATION, TAIL)."""

from __future__ import annotations

import argparse

from isi.cli import _embedding as shared
from isi.errors import InputError


def configure(parser: argparse.ArgumentParser) -> None:
    """Its arguments."""
    parser.add_argument("entity", metavar="ENTITY", nargs="?", help="the head; what is asked for is the tail")
    parser.add_argument("of", metavar="RELATION", nargs="?", help="the relation")
    parser.add_argument("--head", metavar="ENTITY", help="the same as ENTITY")
    parser.add_argument("--relation", metavar="RELATION", help="the same as RELATION")
    parser.add_argument("--tail", metavar="ENTITY", help="the tail; what is asked for is the head")
    shared.add_arguments(parser, top=10)


def run(arguments: argparse.Namespace) -> None:
    """Ask, and tell the ranked answers.

    Raises:
        InputError: where the embedding is broken, a name is unknown, or not one end and the relation are given.
    """
    head, relation = (
        _one(given, option, where)
        for given, option, where in (
            (arguments.entity, arguments.head, "--head"), (arguments.of, arguments.relation, "--relation")
        )
    )  # fmt: skip
    if relation is None or (head is None) == (arguments.tail is None):
        raise InputError("", "", "expected ENTITY RELATION, or --relation RELATION --tail ENTITY")
    model = shared.open_folder(arguments.embedding)
    from isi.bundle.answers import Asker, Question
    from isi.bundle.calibration import HeldOutCalibration
    from isi.bundle.explain import again
    from isi.graph.graph import HEAD, TAIL

    slot = HEAD if head is None else TAIL
    place = "--tail" if head is None else "ENTITY"
    given = model.entity(head if head is not None else arguments.tail, place)
    question = Question(given, model.relation(relation, "RELATION"), slot)
    record = model.kept.inserted().get(model.kept.entity_names[given])
    rehearsal = HeldOutCalibration(model, again(model, record)) if record else None
    answers = Asker(model, rehearsal).ask(question, arguments.top)
    if arguments.json:
        listed = [shared.answer_json(one) for one in answers]
        print(shared.as_json({"question": list(shared.asked(model, question)), "answers": listed}))
        return
    print(f"{' '.join(shared.asked(model, question))} ({shared.meaning(answers, inserted=record is not None)})")
    print(*shared.answer_lines(answers, ["known" if answer.known else "" for answer in answers]), sep="\n")


def _one(given: str | None, option: str | None, name: str) -> str | None:
    """What is given in one way or in another.

    Raises:
        InputError: where it is given in both.
    """
    if given is not None and option is not None:
        raise InputError(name, "", "expected it once: it is given twice")
    return option if given is None else given
