"""The benchmark of insertion: hide entities of a graph, train on the others, insert the hidden ones
from their facts, and rank the answers to three kinds of queries.
"""

from isi.benchmark.evaluation import Evaluation
from isi.benchmark.hidden import HiddenSplit, hide

__all__ = ["Evaluation", "HiddenSplit", "hide"]
