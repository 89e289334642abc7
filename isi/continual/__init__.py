"""Continual benchmarks: a graph that grows, the ranks of its test sets after each snapshot, and
the measures that the field publishes. ``Timeline`` runs an embedding along.
"""

import importlib
from typing import TYPE_CHECKING, Any

from isi.continual.faults import fault_shares
from isi.continual.matrix import PROTOCOLS, evaluate, pooled, query_ranks
from isi.continual.measures import continual_measures
from isi.continual.timeline import BENCHMARKS, GraphSnapshot

if TYPE_CHECKING:
    from isi.continual.api import GrownEmbedding
    from isi.continual.api import RunnableTimeline as Timeline

__all__ = [
    "BENCHMARKS",
    "PROTOCOLS",
    "GraphSnapshot",
    "GrownEmbedding",
    "Timeline",
    "continual_measures",
    "evaluate",
    "fault_shares",
    "pooled",
    "query_ranks",
]

#: Names that need more than stages do, and their names in ``isi.continual.api``.
_IN_API = {"GrownEmbedding": "GrownEmbedding", "Timeline": "RunnableTimeline"}


def __getattr__(name: str) -> Any:
    if name in _IN_API:
        return getattr(importlib.import_module("isi.continual.api"), _IN_API[name])
    raise AttributeError(f"module 'isi.continual' has no attribute {name!r}")
