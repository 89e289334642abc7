"""``isi live``: a process that has an embedding open,
and answers requests in lines of JSON (``isi.live.stream``).
"""

from contextlib import suppress
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter


def live(
    folder: Annotated[Path, Parameter(help="folder of a bundle; its journal lists the changes")],
    *,
    socket: Annotated[
        Path | None, Parameter(help="Unix socket to serve, in place of standard input")
    ] = None,
    vectors: Annotated[
        Path | None, Parameter(help="word2vec or GloVe file, for the vectors of all phrases")
    ] = None,
) -> None:
    """Answer requests until the input ends, or until SIGTERM or Ctrl-C."""
    import asyncio

    import torch

    from isi.live.embedding import open_live
    from isi.live.stream import answer_input, serve

    torch.set_num_threads(1)  # so that equal requests have equal answers
    with open_live(folder, vectors=vectors, journal=True) as opened, suppress(SystemExit):
        steps = opened.groups.preparation()
        asyncio.run(serve(opened, steps, socket)) if socket else answer_input(opened, steps)
