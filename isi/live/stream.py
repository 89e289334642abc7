"""Requests to a live embedding as lines of JSON, from standard input or a Unix socket,
and the line that answers each.

A request has one key of ``VERBS``, perhaps what goes with this verb, and perhaps an ``id``, which
the answer repeats: ``{"ask": ["mug", "atLocation", null], "top": 3, "id": 7}``. docs/live.md lists
them.
"""

import asyncio
import json
import signal
import socket as sockets
import sys
import traceback
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from pathlib import Path
from select import select
from typing import Annotated, Any, Literal, NoReturn

from pydantic import BeforeValidator, Field
from pydantic_core import from_json, to_json

from isi.config import Count, Option, Section, Seed, check
from isi.errors import InputError, at, short, unwritable
from isi.insertion.arguments import listed_triples
from isi.live.embedding import LiveEmbedding
from isi.live.folder import Text
from isi.live.journal import Time
from isi.process import STOPPING

LONGEST = 2**20  #: Maximum number of bytes of a request to a socket.
MOST_QUERIES = 10_000  #: In one request.


def _as_names(names: Any) -> Any:
    return [names] if isinstance(names, str) else [] if names is True else names


def _by_name(entities: Any) -> Any:
    names = _as_names(entities)
    of_texts = isinstance(names, list) and all(isinstance(name, str) for name in names)
    return {name: {} for name in names} if of_texts else names


def _as_queries(queries: Any) -> Any:
    is_single = isinstance(queries, list) and not any(isinstance(part, list) for part in queries)
    return [queries] if is_single and queries else queries


Names = Annotated[list[Text], BeforeValidator(_as_names)]  #: A name, several, or ``true`` for none.
Fact = Annotated[list[Text], Field(min_length=3, max_length=3)]
#: null is what is asked for
Query = Annotated[list[Text | None], Field(min_length=3, max_length=3)]
EachText = Text | dict[Text, Text] | None  #: For one entity, or by name.


Result = Mapping[str, Any]  #: The fields of an answer.


class Request(Section):
    """A request without its ``id``: a verb and what may go with it, named after a method of
    ``LiveEmbedding`` and its parameters.
    """

    def result(self, live: LiveEmbedding) -> Result:
        """Do what is asked; the fields of the answer."""
        raise NotImplementedError


class ChangeRequest(Request):
    """A request that changes the embedding."""

    time: Time | None = None
    source: Text | None = None

    @property
    def stamp(self) -> dict[str, Any]:
        """When it was made, and what reported it."""
        return {"time": self.time, "source": self.source}


class Insert(ChangeRequest):
    #: names alone, or tails by name and relation
    insert: Annotated[dict[Text, dict[Text, Names]], BeforeValidator(_by_name)]
    facts: list[Fact] = Field([])
    definition: EachText = None
    kind: EachText = None
    initializer: Text | None = None
    options: dict[str, Option] = Field({})
    seed: Seed = 0
    new: bool = False
    upsert: bool = False

    def result(self, live: LiveEmbedding) -> Result:
        facts = [*listed_triples(self.insert), *self.facts]
        about = self.model_dump(exclude={"insert", "facts"})
        return vars(live.insert(list(self.insert), facts, **about))


class Observe(ChangeRequest):
    observe: list[Fact]
    upsert: bool = False

    def result(self, live: LiveEmbedding) -> Result:
        return vars(live.observe(self.observe, upsert=self.upsert, **self.stamp))


class Move(ChangeRequest):
    move: Fact
    instead_of: Text | None = None

    def result(self, live: LiveEmbedding) -> Result:
        head, relation, tail = self.move
        return vars(live.move(head, relation, tail, instead_of=self.instead_of, **self.stamp))


class Remove(ChangeRequest):
    remove: Names
    facts: list[Fact] = Field([])

    def result(self, live: LiveEmbedding) -> Result:
        return vars(live.remove(self.remove, self.facts, **self.stamp))


class Undo(ChangeRequest):
    undo: Literal[True]

    def result(self, live: LiveEmbedding) -> Result:
        return vars(live.undo(**self.stamp))


class Ask(Request):
    #: one query, or several
    ask: Annotated[list[Query], BeforeValidator(_as_queries), Field(max_length=MOST_QUERIES)]
    top: Count = 10

    def result(self, live: LiveEmbedding) -> Result:
        results = []
        for head, relation, tail in self.ask:
            best = live.ask(head, relation, tail, self.top)
            results.append({"query": best.query, "sure": best.sure, "answers": best.answers})
        return results[0] if len(results) == 1 else {"results": results}


class Nearest(Request):
    nearest: Text
    top: Count = 10

    def result(self, live: LiveEmbedding) -> Result:
        listed = live.nearest(self.nearest, self.top)
        return {"nearest": [{"entity": name, "cosine": cosine} for name, cosine in listed]}


class Explain(Request):
    explain: Text
    top: Count = 10

    def result(self, live: LiveEmbedding) -> Result:
        return {"explain": live.explain(self.explain, self.top)}


class InterferenceOf(Request):
    interference: Names

    def result(self, live: LiveEmbedding) -> Result:
        return {"interference": live.interference(self.interference)}


class History(Request):
    history: Literal[True]

    def result(self, live: LiveEmbedding) -> Result:
        rows = [change.model_dump(mode="json", exclude_defaults=True) for change in live.history]
        return {"history": rows}


class Compact(Request):
    compact: Literal[True]

    def result(self, live: LiveEmbedding) -> Result:
        return {"compacted": live.compact()}


#: Requests by verb, the key that each of them must have.
VERBS: dict[str, type[Request]] = {
    "insert": Insert,
    "observe": Observe,
    "move": Move,
    "remove": Remove,
    "undo": Undo,
    "ask": Ask,
    "nearest": Nearest,
    "explain": Explain,
    "interference": InterferenceOf,
    "history": History,
    "compact": Compact,
}


def answer(live: LiveEmbedding, line: bytes) -> bytes:
    """The line that answers a request: what was done or found.

    ``notes`` say which known name a question is about if it has another spelling. A request that
    is refused has the key ``error`` in its answer, and nothing has changed. So has
    one that fails unexpectedly (``internal: ...``); its traceback goes to standard error.
    """
    label: dict[str, Any] = {}
    try:
        with at("request"):
            request = _parsed(line)
            label = _label(request)
            verbs = [verb for verb in VERBS if verb in request]
            if len(verbs) != 1:
                expected = f"expected one of {', '.join(VERBS)}"
                raise InputError("", "", f"{expected}, got {short(list(request))}")
            given = check(request, VERBS[verbs[0]], "", "")
        notes = list[str]()
        live.note = notes.append
        result = dict(given.result(live))
        if notes:
            result["notes"] = notes
        return to_json(label | result, inf_nan_mode="null") + b"\n"
    except InputError as error:
        result = {"error": str(error)}
    except Exception as error:  # a fault of ours must not end the process, which serves others
        result = {"error": log_internal(error)}
    return to_json(label | result) + b"\n"


def _label(request: dict[str, Any]) -> dict[str, Any]:
    """The ``id`` of a request, taken out of it;
    an ``InputError`` refuses one that no answer can repeat.
    """
    if "id" not in request:
        return {}
    label = {"id": request.pop("id")}
    try:
        from_json(to_json(label), allow_inf_nan=False)
    except ValueError as error:  # half of a character, an infinite number, hundreds of nested lists
        raise InputError(
            "", "id", f"expected a value that JSON holds, got {short(label['id'])}"
        ) from error
    return label


def log_internal(error: Exception) -> str:
    """Print the traceback of an unexpected error to standard error;
    one line that says what it was.
    """
    traceback.print_exception(error)
    return f"internal: {type(error).__name__}: {short(str(error))}"


def _parsed(line: bytes) -> dict[str, Any]:
    """A request as an object; InputError for other text,
    and for a key that stands in an object twice.
    """
    try:
        text = line.decode("utf-8-sig")
        request = json.loads(text, object_pairs_hook=_keys_once, parse_constant=_refuse_constant)
    except UnicodeDecodeError:
        raise  # ``at`` says where
    except (ValueError, RecursionError) as error:
        raise InputError("", "", f"expected an object in JSON ({short(str(error))})") from error
    if not isinstance(request, dict):
        raise InputError("", "", f"expected an object in JSON, got {short(request)}")
    return request


def _keys_once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    result = dict[str, Any]()
    for key, value in pairs:
        if key in result:
            raise InputError("", "", f"expected each key once, got {short(key)} twice")
        result[key] = value
    return result


def _refuse_constant(name: str) -> NoReturn:
    raise InputError("", "", f"expected a finite number, got {name}")


def take_step(steps: Iterator[Callable[[], object]]) -> bool:
    """Take the next step of a preparation (``EntityGroups.preparation``), if any is left;
    a failure is logged.
    """
    step = next(steps, None)
    if step is None:
        return False
    try:
        step()
    except Exception as error:  # the requests that need it say so again
        log_internal(error)
    return True


def answer_input(live: LiveEmbedding, steps: Iterator[Callable[[], object]]) -> None:
    """Answer standard input on standard output, to its end.
    While no request waits, take the next of the ``steps``.
    """
    # without a buffer, which ``select`` would not see
    with open(0, "rb", buffering=0, closefd=False) as requests:
        while True:
            while not select([requests], [], [], 0)[0] and take_step(steps):
                pass
            if not (line := requests.readline()):
                return
            sys.stdout.buffer.write(answer(live, line))
            sys.stdout.buffer.flush()


async def serve(live: LiveEmbedding, steps: Iterator[Callable[[], object]], socket: Path) -> None:
    """Answer the clients of a Unix socket, a request of each in turn, until SIGTERM or Ctrl-C.

    Only its owner can connect to the socket. An ``InputError`` refuses one that another process
    serves.
    """

    async def talk(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        with suppress(ConnectionError, asyncio.CancelledError, SystemExit):  # gone, or stopped
            while line := await _request(reader):
                is_too_long = len(line) > LONGEST
                writer.write(_TOO_LONG if is_too_long else answer(live, line))
                await writer.drain()
                if is_too_long:
                    break
                await asyncio.sleep(0)  # the turn of others
        writer.close()

    stopped = asyncio.Event()
    _stop_by_signals(asyncio.get_running_loop(), stopped)
    if _is_served(socket):
        raise InputError(socket, "", "another process serves this socket: choose another name")
    try:
        server = await asyncio.start_unix_server(talk, socket, limit=LONGEST)
        socket.chmod(0o600)
        own = socket.stat().st_ino
    except OSError as error:
        raise unwritable(socket, error) from error
    try:
        async with server:
            while not stopped.is_set() and take_step(steps):
                await asyncio.sleep(0)
            await stopped.wait()
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        with suppress(OSError):
            if socket.stat().st_ino == own:  # else another process serves it by now
                socket.unlink()


_TOO_LONG = to_json({"error": f"request: expected at most {LONGEST:,} bytes in a line"}) + b"\n"


async def _request(reader: asyncio.StreamReader) -> bytes:
    """The next line of a client; of one that is too long, the first part,
    which is too long, too.
    """
    try:
        return await reader.readuntil(b"\n")
    except asyncio.IncompleteReadError as error:
        return error.partial
    except asyncio.LimitOverrunError:
        return await reader.readexactly(LONGEST + 1)


def _is_served(socket: Path) -> bool:
    """Whether a process answers at a socket; one that a killed process has left is free."""
    with sockets.socket(sockets.AF_UNIX) as client:
        client.settimeout(1)
        try:
            client.connect(str(socket))
        except TimeoutError:
            return True  # busy
        except OSError:
            return False
    return True


def _stop_by_signals(loop: asyncio.AbstractEventLoop, stopped: asyncio.Event) -> None:
    """End the process at once on SIGTERM and Ctrl-C,
    within a step of the preparation or a request, too.

    What such a request has not written to the journal is not done; a part of a line does not count.
    """

    def stop(*_: object) -> NoReturn:
        # Python ignores exceptions in some places, as in a destructor: again after a second
        signal.setitimer(signal.ITIMER_REAL, 1)
        loop.call_soon_threadsafe(stopped.set)
        raise SystemExit(0)

    for number in (*STOPPING, signal.SIGALRM):
        signal.signal(number, stop)
