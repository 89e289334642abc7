"""Requests to a home as lines of JSON, from standard input or a Unix socket,
and the line that answers each.

A request has one key of ``VERBS``, perhaps what goes with this verb, and perhaps an ``id``, which
the answer repeats: ``{"ask": ["mug", "atLocation", null], "top": 3, "id": 7}``. docs/live.md lists
them.
"""

import json
import multiprocessing
import os
import socket as sockets
import traceback
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from datetime import timedelta
from pathlib import Path
from socketserver import StreamRequestHandler, ThreadingUnixStreamServer
from typing import Annotated, Any, Literal, NoReturn

from pydantic import BeforeValidator, Field, TypeAdapter
from pydantic_core import from_json, to_json

from isi.config import Count, Section, check
from isi.errors import InputError, at, short, unwritable
from isi.home.bundle import Text
from isi.home.changes import Confidence, Effect, Stamp, TellOptions
from isi.home.home import Home, open_home
from isi.insertion.arguments import listed_triples
from isi.process import become_worker

LONGEST = 2**20  #: Maximum number of bytes of a request to a socket.
MOST_QUERIES = 10_000  #: In one request.
#: Seconds of each unit of an age: ``30d``, ``12h``.
UNITS = {"s": 1, "m": 60, "h": 3600, "d": 86400, "w": 604800}


def as_age(text: Any) -> Any:
    """A duration of a text such as ``30d``, ``12h``, ``90m``."""
    if not isinstance(text, str):
        return text
    number, unit = text[:-1], text[-1:]
    if not (number.isdecimal() and len(number) < 5 and unit in UNITS):
        raise ValueError(f"expected a number and one of {', '.join(UNITS)}, as in 30d")
    return timedelta(seconds=int(number) * UNITS[unit])


def _as_names(names: Any) -> Any:
    return [names] if isinstance(names, str) else [] if names is True else names


def _by_name(entities: Any) -> Any:
    names = _as_names(entities)
    of_texts = isinstance(names, list) and all(isinstance(name, str) for name in names)
    return {name: {} for name in names} if of_texts else names


def _as_queries(queries: Any) -> Any:
    is_single = isinstance(queries, list) and not any(isinstance(part, list) for part in queries)
    return [queries] if is_single and queries else queries


Age = Annotated[timedelta, BeforeValidator(as_age)]
#: A name, several, or ``true`` for none.
JsonNames = Annotated[list[Text], BeforeValidator(_as_names)]
JsonFact = Annotated[list[Text], Field(min_length=3, max_length=3)]
#: None is what is asked for
JsonQuery = Annotated[list[Text | None], Field(min_length=3, max_length=3)]

JsonAnswer = Mapping[str, Any]  #: The fields of an answer.


class Request(Section):
    """A request without its ``id``: a verb and what may go with it, named after a method of
    ``Home`` and its parameters.
    """

    def first(self, value: Any) -> Sequence[Any]:
        """The first arguments of the method, by the value of the verb's key; ``true``: none."""
        return [] if value is True else [value]

    def result(self, home: Home, verb: str) -> JsonAnswer:
        """Do what is asked; the fields of the answer."""
        options = dict(self)
        first = self.first(options.pop(verb))
        effect: Effect = getattr(home, verb)(*first, **options)
        return vars(effect)


class Tell(Request, TellOptions):
    tell: list[list[Any]]
    entities: JsonNames = Field([])


class Insert(Request, TellOptions):
    #: names alone, or tails by name and relation
    insert: Annotated[dict[Text, dict[Text, JsonNames]], BeforeValidator(_by_name)]
    facts: list[list[Any]] = Field([])
    upsert: bool = False

    def result(self, home: Home, verb: str) -> JsonAnswer:
        facts = [*listed_triples(self.insert), *self.facts]
        options = dict(self) | {"facts": facts}
        del options[verb]
        return vars(home.insert(list(self.insert), **options))


class Observe(Request, Stamp):
    observe: list[list[Any]]
    upsert: bool = False
    confidence: Confidence | None = None


class Move(Request, Stamp):
    move: JsonFact
    instead_of: Text | None = None

    def first(self, value: Any) -> Sequence[Any]:
        """Head, relation and tail."""
        return list(value)


class Remove(Request, Stamp):
    remove: JsonNames
    facts: list[JsonFact] = Field([])


class Undo(Request, Stamp):
    undo: Literal[True]


class Ask(Request):
    #: one query, or several
    ask: Annotated[list[JsonQuery], BeforeValidator(_as_queries), Field(max_length=MOST_QUERIES)]
    top: Count = 10
    new: bool = False
    among: list[Text] | None = None

    def result(self, home: Home, verb: str) -> JsonAnswer:
        options = dict(self)
        results = []
        for query in options.pop(verb):
            best = home.ask(*query, **options)
            fields = {"query": best.query, "sure": best.sure, "answers": best.answers}
            results.append(fields | ({"notes": best.notes} if best.notes else {}))
        return results[0] if len(results) == 1 else {"results": results}


class Explain(Request):
    explain: Text

    def result(self, home: Home, verb: str) -> JsonAnswer:
        return {verb: home.explain(self.explain)}


class History(Request):
    history: Literal[True]
    #: facts that were not seen for so long, instead of changes
    stale: Age | None = None

    def result(self, home: Home, verb: str) -> JsonAnswer:
        if self.stale is not None:
            return {"stale": home.stale(self.stale)}
        return {verb: home.history}


#: Requests by verb, the key that each of them must have.
VERBS: dict[str, type[Request]] = {
    "tell": Tell,
    "insert": Insert,
    "observe": Observe,
    "move": Move,
    "remove": Remove,
    "undo": Undo,
    "ask": Ask,
    "explain": Explain,
    "history": History,
}


def answer(home: Home, line: bytes) -> bytes:
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
            verbs = VERBS.keys() & request.keys()
            if len(verbs) != 1:
                expected = f"expected one of {', '.join(VERBS)}"
                raise InputError("", "", f"{expected}, got {short(list(request))}")
            (verb,) = verbs
            checked = check(request, VERBS[verb], "", "")
        result = checked.result(home, verb)
        return to_json(label | dict(result), inf_nan_mode="null") + b"\n"
    except InputError as error:
        result = {"error": str(error)}
    except Exception as error:  # a fault of ours must not end the process, which serves others
        traceback.print_exception(error)
        result = {"error": f"internal: {type(error).__name__}: {short(str(error))}"}
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


def answer_input(home: Home) -> None:
    """Answer standard input on standard output, to its end."""
    for descriptor in (0, 1):  # a pipe that does not block would lose requests and answers
        os.set_blocking(descriptor, True)
    with open(0, "rb", closefd=False) as requests, open(1, "wb", closefd=False) as answers:
        while line := requests.readline():
            answers.write(answer(home, line))
            answers.flush()


def serve(home: Home, socket: Path) -> None:
    """Answer the clients of a Unix socket, each in a thread, until the process is stopped.

    Only its owner can connect to the socket. An ``InputError`` refuses one that another process
    serves.
    """

    class Handler(StreamRequestHandler):
        def handle(self) -> None:
            with suppress(ConnectionError):
                while line := self.rfile.readline(LONGEST + 1):
                    if len(line) > LONGEST:
                        self.wfile.write(_TOO_LONG)
                        return
                    self.wfile.write(answer(home, line))

    if _is_served(socket):
        raise InputError(socket, "", "another process serves this socket: choose another name")
    try:
        with suppress(FileNotFoundError):
            if socket.is_socket():  # of a process that was killed
                socket.unlink()
        server = ThreadingUnixStreamServer(str(socket), Handler)
        socket.chmod(0o600)
        inode = socket.stat().st_ino
    except OSError as error:
        raise unwritable(socket, error) from error
    server.daemon_threads, server.block_on_close = True, False
    try:
        server.serve_forever()
    finally:
        server.server_close()
        with suppress(OSError):
            if socket.stat().st_ino == inode:  # else another process serves it by now
                socket.unlink()


@contextmanager
def prepared_beside(home: Home) -> Iterator[None]:
    """While requests are answered, make the choices that a home still lacks in another process,
    which stores them.
    """
    process = None
    may_store = home.folder is not None and not home.database.is_read_only
    if may_store and home.derived.choices.preparation():
        spawn = multiprocessing.get_context("spawn")
        process = spawn.Process(target=_prepare, args=(home.folder, os.getpid()), daemon=True)
        process.start()
    try:
        yield
    finally:
        if process is not None:
            process.kill()


def _prepare(folder: Path, parent: int) -> None:
    become_worker(parent)
    os.environ |= {"OMP_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}
    with suppress(InputError), open_home(folder) as home:  # an insertion that needs it says so
        home.prepare()


_TOO_LONG = to_json({"error": f"request: expected at most {LONGEST:,} bytes in a line"}) + b"\n"


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


#: A duration of a text, for the command.
AGE: TypeAdapter[timedelta] = TypeAdapter(Age)
