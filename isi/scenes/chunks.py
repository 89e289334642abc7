"""Any number of scenes, a chunk at a time: here, or on workers."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Executor, Future
from itertools import islice
from typing import TypeVar

Item = TypeVar("Item")
Done = TypeVar("Done")

#: Chunks with the workers, or waiting for them, at once.
IN_FLIGHT = 16


def chunked(items: Iterable[Item], size: int) -> Iterator[list[Item]]:
    """Lists of ``size`` items, the last one perhaps shorter."""
    rest = iter(items)
    while chunk := list(islice(rest, size)):
        yield chunk


def map_in_order(
    function: Callable[[Item], Done], items: Iterable[Item], executor: Executor | None = None
) -> Iterator[Done]:
    """Results in the order of the items, which are taken only as they are needed.

    Args:
        function: what to do with an item.
        items: as many as there are; no more than ``IN_FLIGHT`` are held at once.
        executor: where to do it; here, without one.
    """
    if executor is None:
        yield from map(function, items)
        return
    pending: deque[Future[Done]] = deque()
    try:
        for item in items:
            pending.append(executor.submit(function, item))
            if len(pending) == IN_FLIGHT:
                yield pending.popleft().result()
        while pending:
            yield pending.popleft().result()
    finally:
        for future in pending:
            future.cancel()
