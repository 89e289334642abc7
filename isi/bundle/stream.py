"""Requests to a live embedding as lines of JSON, from standard input or a Unix socket, and the line that answers each.

A request has one key of ``VERBS``, perhaps more keys of ``Request``, and perhaps an ``id``, which the answer repeats:
``{"ask": ["mug", "atLocation", null], "top": 3, "id": 7}``. docs/live.md lists them.
"""

import asyncio
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from pathlib import Path
from select import select
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field, TypeAdapter
from pydantic_core import to_json

from isi.bundle.answers import Answers
from isi.bundle.folder import Text
from isi.bundle.live import LiveEmbedding
from isi.config import Count, Option, Section, Seed, check
from isi.errors import InputError, at, short, unwritable
from isi.insertion.arguments import listed_triples
from isi.process import STOPPING

LONGEST = 2**20  #: Maximum number of bytes of a request to a socket.


def _as_names(names: Any) -> Any:
    return [names] if isinstance(names, str) else [] if names is True else names


def _by_name(entities: Any) -> Any:
    names = _as_names(entities)
    of_texts = isinstance(names, list) and all(isinstance(name, str) for name in names)
    return {name: {} for name in names} if of_texts else names


Names = Annotated[list[Text], BeforeValidator(_as_names)]  #: A name, several, or ``true`` for none.
Facts = list[Annotated[list[Text], Field(min_length=3, max_length=3)]]
EachText = Text | dict[Text, Text] | None  #: For one entity, or by name.


class Request(Section):
    """A request without its ``id``; the keys are named after methods of ``LiveEmbedding`` and their parameters."""

    #: names alone, or tails by name and relation
    insert: Annotated[dict[Text, dict[Text, Names]], BeforeValidator(_by_name)] = Field({})
    observe: Facts = Field([])
    remove: Names = Field([])
    undo: Literal[True] = True
    ask: Annotated[list[Text | None], Field(min_length=3, max_length=3)] = Field([])  #: null is what is asked for
    nearest: Text = ""
    explain: Text = ""
    interference: Names = Field([])
    history: Literal[True] = True
    facts: Facts = Field([])
    definition: EachText = None
    kind: EachText = None
    initializer: Text | None = None
    options: dict[str, Option] = Field({})
    seed: Seed = 0
    new: bool = False
    top: Count = 10


def _answers(best: Answers) -> Mapping[str, Any]:
    return {"query": best.query, "sure": best.sure, "answers": best.answers}


_ABOUT = {"definition", "kind", "initializer", "options", "seed", "new"}
#: By verb, the fields of the answer to a request.
VERBS: dict[str, Callable[[LiveEmbedding, Request], Mapping[str, Any]]] = {
    "insert": lambda live, given: vars(
        live.insert(
            list(given.insert), [*listed_triples(given.insert), *given.facts], **given.model_dump(include=_ABOUT)
        )
    ),
    "observe": lambda live, given: vars(live.observe(given.observe)),
    "remove": lambda live, given: vars(live.remove(given.remove, given.facts)),
    "undo": lambda live, _: vars(live.undo()),
    "ask": lambda live, given: _answers(live.ask(*given.ask, top=given.top)),  # type: ignore[misc, arg-type]
    "nearest": lambda live, given: {
        "nearest": [{"entity": name, "cosine": cosine} for name, cosine in live.nearest(given.nearest, given.top)]
    },
    "explain": lambda live, given: {"explain": live.explain(given.explain, given.top)},
    "interference": lambda live, given: {"interference": live.interference(given.interference)},
    "history": lambda live, _: {"history": [change.model_dump(exclude_defaults=True) for change in live.history]},
}  # fmt: skip
_OBJECT = TypeAdapter(dict[str, Any])


def answer(live: LiveEmbedding, line: bytes) -> bytes:
    """The line that answers a request: what was done or found; ``error`` if it is refused, and then nothing changed."""
    label: dict[str, Any] = {}
    try:
        with at("request"):
            request = _OBJECT.validate_json(line.removeprefix(b"\xef\xbb\xbf"))
            label = {"id": request.pop("id")} if "id" in request else {}
            given = check(request, Request, "", "")
            if len(verbs := VERBS.keys() & request.keys()) != 1:
                raise InputError("", "", f"expected one of {', '.join(VERBS)}, got {short(list(request))}")
        result = VERBS[verbs.pop()](live, given)
    except InputError as error:
        result = {"error": str(error)}
    return to_json(label | dict(result), inf_nan_mode="null") + b"\n"


def answer_input(live: LiveEmbedding, steps: Iterator[None]) -> None:
    """Answer standard input on standard output, to its end. While no request waits, take the next of the ``steps``."""
    with open(0, "rb", buffering=0, closefd=False) as requests:  # without a buffer, which ``select`` would not see
        while True:
            while not select([requests], [], [], 0)[0] and next(steps, True) is None:
                pass
            if not (line := requests.readline()):
                return
            sys.stdout.buffer.write(answer(live, line))
            sys.stdout.buffer.flush()


async def serve(live: LiveEmbedding, steps: Iterator[None], socket: Path) -> None:
    """Answer the clients of a Unix socket, a request of each in turn, until SIGTERM or Ctrl-C."""

    async def talk(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        with suppress(ConnectionError, ValueError, asyncio.CancelledError):  # gone, too long a request, stopped
            while line := await reader.readline():
                writer.write(answer(live, line))
                await writer.drain()
                await asyncio.sleep(0)  # the turn of others
        writer.close()

    stopped = asyncio.Event()
    for number in STOPPING:
        asyncio.get_running_loop().add_signal_handler(number, stopped.set)
    try:
        await asyncio.start_unix_server(talk, socket, limit=LONGEST)
    except OSError as error:
        raise unwritable(socket, error) from error
    try:
        for _ in steps:
            await asyncio.sleep(0)
        await stopped.wait()
    finally:
        socket.unlink(missing_ok=True)
