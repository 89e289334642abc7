"""Requests to a home as lines of JSON, from standard input or a Unix socket,
and the line that answers each.

A request has one verb as a key (``isi.home.verbs``), perhaps its fields, and perhaps an ``id``,
which the answer repeats: ``{"ask": ["mug", "atLocation", null], "top": 3, "id": 7}``. docs/live.md
lists them.
"""

import json
import multiprocessing
import os
import socket as sockets
import traceback
from collections.abc import Collection, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from socketserver import StreamRequestHandler, ThreadingUnixStreamServer
from typing import Any, NoReturn

from pydantic_core import from_json, to_json

from isi.config import check, check_keys
from isi.errors import InputError, at, short, unwritable
from isi.home.answers import Answers
from isi.home.changes import Effect
from isi.home.home import Home, open_home
from isi.home.verbs import VERBS, Ask, Verb
from isi.process import become_worker

LONGEST = 2**20  #: Maximum number of bytes of a request to a socket.
MOST_QUERIES = 10_000  #: In one request.


def _verbs(request: dict[str, Any], allowed: Collection[str]) -> list[Verb]:
    """What a request says: a verb, or several questions."""
    present = set(allowed) & request.keys()
    # `facts` is a verb, and a field of two others
    names = [name for name in present if present - {name} <= VERBS[name].model_fields.keys()]
    if len(names) != 1:
        expected = f"expected one of {', '.join(allowed)}"
        raise InputError("", "", f"{expected}, got {short(list(request))}")
    (name,) = names
    value = request.pop(name)
    is_several = isinstance(value, list) and value and all(isinstance(row, list) for row in value)
    if name != Ask.name() or not is_several:
        return [_verb(name, value, request)]
    if len(value) > MOST_QUERIES:
        raise InputError("", name, f"expected at most {MOST_QUERIES:,} queries, got {len(value):,}")
    return [_verb(name, query, request) for query in value]


def _verb(name: str, value: Any, options: Mapping[str, Any]) -> Verb:
    """The verb of a request. The value of its key fills the first fields; ``true``: none."""
    kind, fields = VERBS[name], dict(options)
    values = value if len(kind.places) > 1 else [value]
    if value is not True:
        if not isinstance(values, list) or len(values) != len(kind.places):
            expected = ", ".join(kind.places) or "true"
            raise InputError("", name, f"expected {expected}, got {short(value)}")
        for field, each in zip(kind.places, values, strict=True):
            if fields.setdefault(field, each) is not each:
                raise InputError("", field, f"expected this once: it is the value of {name}, too")
    return check(fields, kind, "", "")


def _fields(name: str, result: Any) -> Mapping[str, Any]:
    """The fields of the answer with the result of a verb."""
    if isinstance(result, Effect):
        return vars(result)
    if isinstance(result, Answers):
        fields = {"query": result.query, "sure": result.sure, "answers": result.answers}
        return fields | ({"notes": result.notes} if result.notes else {})
    return {name: result}


def answer(home: Home, line: bytes, verbs: Collection[str] = VERBS.keys()) -> bytes:
    """The line that answers a request with one of some verbs: what was done or found.

    ``notes`` say which known name another spelling was taken for. A request that is refused has the
    key ``error`` in its answer, and nothing has changed. So has one that fails unexpectedly
    (``internal: ...``); its traceback goes to standard error.
    """
    label: dict[str, Any] = {}
    try:
        with at("request"):
            request = _parsed(line)
            label = _label(request)
            requested = _verbs(request, verbs)
        answers = [_fields(verb.name(), verb.of(home)) for verb in requested]
        result = answers[0] if len(answers) == 1 else {"results": answers}
        return to_json(label | dict(result), inf_nan_mode="null") + b"\n"
    except InputError as error:
        result = {"error": str(error)}
    except Exception as error:  # a fault of ours must not end the process, which serves others
        traceback.print_exception(error)
        result = {"error": f"internal: {type(error).__name__}: {short(str(error))}"}
    return to_json(label | dict(result)) + b"\n"


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
        check_keys(text)
        request = json.loads(text, parse_constant=_refuse_constant)
    except UnicodeDecodeError:
        raise  # ``at`` says where
    except (ValueError, RecursionError) as error:
        raise InputError("", "", f"expected an object in JSON ({short(str(error))})") from error
    if not isinstance(request, dict):
        raise InputError("", "", f"expected an object in JSON, got {short(request)}")
    return request


def _refuse_constant(name: str) -> NoReturn:
    raise InputError("", "", f"expected a finite number, got {name}")


def answer_input(home: Home) -> None:
    """Answer standard input on standard output, to its end."""
    os.set_blocking(0, True)  # a pipe that does not block would lose requests
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
