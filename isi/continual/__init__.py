"""Continual benchmarks: a graph that grows, the ranks of its test sets after each snapshot, and
the measures that the field publishes.
"""

from isi.continual.api import GrownEmbedding, Timeline
from isi.continual.faults import fault_shares
from isi.continual.matrix import PROTOCOLS, evaluate, pooled, query_ranks
from isi.continual.measures import continual_measures
from isi.continual.timeline import BENCHMARKS, GraphSnapshot

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
