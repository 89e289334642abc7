"""A `python` that starts at once: a process that has loaded the large libraries forks for each
command. (Importing torch and pandas takes most of the time of a small stage.)

Every command loads the code of `isi` and of its stage itself, from its own folder.
"""

import atexit
import gc
import importlib
import json
import os
import runpy
import signal
import socket
import subprocess
import sys
import traceback
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import NoReturn

from tests.environment import ENVIRONMENT

ROOT = Path(__file__).parent.parent
LIBRARIES = (
    "dvc.cli",
    "dvc.commands.repro",
    "jinja2",
    "matplotlib.backends.backend_agg",
    "matplotlib.backends.backend_svg",
    "matplotlib.pyplot",
    "networkx",
    "numba",
    "pandas",
    "pyarrow.parquet",
    "pydantic",
    "ruamel.yaml",
    "safetensors.torch",
    "torch",
)
#: The `python` of commands: hands its arguments and files on, and ends with the status of the fork.
CLIENT = """#!{python} -IS
import json, os, socket, sys
if sys.argv[1] != "-m":
    os.execv({python!r}, [{python!r}, *sys.argv[1:]])
with socket.socket(socket.AF_UNIX) as server:
    server.connect({address!r})
    socket.send_fds(server, [b" "], [0, 1, 2])
    command = dict(arguments=sys.argv[2:], folder=os.getcwd(), environment=dict(os.environ))
    server.sendall(json.dumps(command).encode())
    server.shutdown(socket.SHUT_WR)
    sys.exit(int(server.makefile().read()))
"""


@contextmanager
def warm_python(folder: Path) -> Iterator[dict[str, str]]:
    """An environment in which `python -m ...` is a fork; its socket and script are in `folder`."""
    address, script = str(folder / "socket"), folder / "python"
    script.write_text(CLIENT.format(python=sys.executable, address=address), encoding="utf-8")
    script.chmod(0o755)
    with socket.socket(socket.AF_UNIX) as server:
        server.bind(address)
        server.listen()
        command = [sys.executable, "-m", __name__, str(server.fileno())]
        process = subprocess.Popen(command, cwd=ROOT, pass_fds=[server.fileno()])
    try:
        yield ENVIRONMENT | {"PATH": f"{folder}{os.pathsep}{ENVIRONMENT['PATH']}"}
    finally:
        process.kill()
        process.wait()


def _serve(server: socket.socket) -> None:
    """Fork for each command; returns in the fork, which is ready to run its command."""
    for name in LIBRARIES:
        importlib.import_module(name)
    # of DVC's two parsers the quick one, since no lock file here has comments
    parsers = importlib.import_module("dvc.utils.serialize._yaml")
    parsers.parse_yaml_for_update = parsers.parse_yaml  # type: ignore[attr-defined]
    gc.freeze()  # a collection in a fork would copy all that they have made
    signal.signal(signal.SIGCHLD, signal.SIG_IGN)  # nobody waits for `_watch`
    while True:
        connection, _ = server.accept()
        if not os.fork():
            server.close()
            return _begin(connection)
        connection.close()


def _begin(connection: socket.socket) -> None:
    """Fork once more: this process waits for the end of the command, to tell the client."""
    signal.signal(signal.SIGCHLD, signal.SIG_DFL)
    _, files, _, _ = socket.recv_fds(connection, 1, 3)
    command = json.loads(connection.makefile().read())
    if process := os.fork():
        _, status = os.waitpid(process, 0)
        connection.sendall(str(os.waitstatus_to_exitcode(status)).encode())
        os._exit(0)
    connection.close()
    for target, file in enumerate(files):
        os.dup2(file, target)
        os.close(file)
    os.chdir(command["folder"])
    os.environ.clear()
    os.environ.update(command["environment"])
    sys.argv = command["arguments"]
    sys.path[0] = command["folder"]


def _status() -> int:
    """Run the command; returns its exit status."""
    try:
        runpy.run_module(sys.argv[0], run_name="__main__", alter_sys=True)
    except SystemExit as ended:
        if isinstance(ended.code, str):
            print(ended.code, file=sys.stderr)
        return ended.code if isinstance(ended.code, int) else int(ended.code is not None)
    except BaseException:
        traceback.print_exc()
        return 1
    return 0


def _end(status: int) -> NoReturn:
    """End this process without freeing what the libraries have made, which takes a second."""
    atexit._run_exitfuncs()
    for stream in (sys.stdout, sys.stderr):
        stream.flush()
    os._exit(status)


if __name__ == "__main__":
    _serve(socket.socket(fileno=int(sys.argv[1])))
    _end(_status())
