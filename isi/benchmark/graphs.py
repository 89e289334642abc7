"""Graphs to hide entities of: a shipped table, PyKEEN's datasets, triples of a caller."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import torch

from isi.columns import TRIPLE
from isi.errors import InputError, extra, suggestion
from isi.graph.graph import Graph
from isi.insertion.arguments import listed_triples, named_triples, naming_argument
from isi.tables import paths
from isi.vocabulary import names_by_id, numbered


def graph_of(triples: Any) -> Graph:
    """The graph of a name (``named``), of triples of labels or ids in any form of
    ``isi.insert``, or of a triples factory of PyKEEN's. InputError names the argument.

    Entities and relations are in the order of a factory's ids, else sorted; those without triples
    are left out. The label of an id is its text.
    """
    with naming_argument("triples"):
        if isinstance(triples, str):
            return named(triples)
        if hasattr(triples, "mapped_triples"):
            return _of_factory(triples)
        rows = listed_triples(triples)
        if not isinstance(rows, np.ndarray) or rows.dtype.kind not in "iu":
            rows = named_triples(rows)
        if rows.ndim != 2 or rows.shape[1] != len(TRIPLE) or not len(rows):
            raise InputError("", "", "expected triples: head, relation and tail")
    return each_once(rows)


def each_once(triples: np.ndarray) -> Graph:
    """The graph of triples, (T, 3), of labels or numbers, each triple once, in the given order."""
    ids, entities, relations = numbered(triples, in_order=True)
    _, first = np.unique(ids, axis=0, return_index=True)
    return unweighted(list(map(str, entities)), list(map(str, relations)), ids[np.sort(first)])


def unweighted(entities: Sequence[str], relations: Sequence[str], triples: np.ndarray) -> Graph:
    """A graph without kinds, each of whose triples, ids (T, 3), was observed once."""
    ones = torch.ones(len(triples), dtype=torch.int64)
    kinds = torch.zeros(len(entities), dtype=torch.int64)
    return Graph(list(entities), list(relations), torch.from_numpy(triples), ones, kinds)


def named(name: str) -> Graph:
    """A graph that ships as ``data/raw/<name>/triples.csv`` with the checkout in the current
    folder, or a dataset of PyKEEN's, all its splits.
    """
    path = paths.RAW / name / "triples.csv"
    if name and path.is_file():
        import pandas as pd

        table = pd.read_csv(path, keep_default_na=False)
        return each_once(table[list(TRIPLE)].to_numpy(object))
    with extra("pykeen"):
        from pykeen.datasets import dataset_resolver, get_dataset

    if name not in dataset_resolver.lookup_dict:
        known = suggestion(name, dataset_resolver.lookup_dict)
        raise InputError("", "", f"expected the name of a dataset, got {name!r:.80}{known}")
    dataset = get_dataset(dataset=name)
    splits = [factory.mapped_triples for factory in dataset.factory_dict.values()]
    triples = torch.unique(torch.cat(splits), dim=0)
    entities, relations = names_by_id(dataset.entity_to_id), names_by_id(dataset.relation_to_id)
    return unweighted(entities, relations, triples.numpy())


def _of_factory(factory: Any) -> Graph:
    ids = np.unique(factory.mapped_triples.numpy(), axis=0)
    graph = each_once(ids)
    if not hasattr(factory, "entity_to_id"):
        return graph
    entities, relations = factory.entity_id_to_label, factory.relation_id_to_label
    return unweighted(
        [entities[int(entity)] for entity in graph.entities],
        [relations[int(relation)] for relation in graph.relations],
        graph.triples.numpy(),
    )
