"""``isi live``: a process that has an embedding open,
and answers requests in lines of JSON (``isi.home.stream``).
"""

from contextlib import suppress
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from isi.cli import HOME


def live(
    folder: Annotated[Path, Parameter(name="--home", help="folder of a home")] = HOME,
    *,
    socket: Annotated[
        Path | None, Parameter(help="Unix socket to serve, in place of standard input")
    ] = None,
) -> None:
    """Answer requests until the input ends, or until SIGTERM or Ctrl-C."""
    import torch

    import isi.home.groups  # noqa: F401  # no insertion waits until it is loaded
    from isi.home.home import open_home
    from isi.home.stream import answer_input, prepared_beside, serve

    torch.set_num_threads(1)  # so that equal requests have equal answers
    with open_home(folder) as home, prepared_beside(home), suppress(SystemExit):
        serve(home, socket) if socket else answer_input(home)
