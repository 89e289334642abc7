"""Ranks of the answers about hidden entities, by any embedding that has vectors for them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
import torch
from torch import Tensor

from isi.errors import InputError, short
from isi.insertion.arguments import checked_model, table
from isi.insertion.request import stack_of_one
from isi.insertion.result import Inserted
from isi.models.model import Model
from isi.models.stack import Embedding

if TYPE_CHECKING:
    import pandas as pd

#: Values of ``asked``: the answer is the known or the hidden end of a query triple, or an end of an
#: earlier triple.
ASKED = ("known", "hidden", "earlier")


@dataclass(frozen=True, repr=False)
class Evaluation:
    """Filtered mean reciprocal ranks (MRR) of three kinds of answers; NaN if there is no query."""

    known: float  #: (hidden, relation, ?) and (?, relation, hidden): the answer is a known entity
    hidden: float  #: (known, relation, ?) and (?, relation, known): the answer is a hidden entity
    earlier: float  #: both ends of triples of known entities
    #: a row for each query: ``asked`` (known, hidden, earlier), ``head``, ``relation``, ``tail``,
    #: ``slot`` of the answer (head, tail), and its ``rank``
    ranks: pd.DataFrame = field(compare=False)

    def __repr__(self) -> str:
        return (
            f"MRR of known ends {self.known:.3f}, hidden ones {self.hidden:.3f}, "
            f"earlier triples {self.earlier:.3f}"
        )

    def measures(self) -> pd.DataFrame:
        """A row for each kind of queries that there are: ``asked``, ``queries``, ``mrr``,
        ``hits_at_10``.
        """
        ranks = self.ranks["rank"]
        values = self.ranks.assign(mrr=1 / ranks, hits_at_10=(ranks <= 10).astype(float))
        by_kind = values.groupby("asked", sort=False)
        means = by_kind[["mrr", "hits_at_10"]].mean()
        means.insert(0, "queries", by_kind.size())
        return means.reset_index()


def evaluation_of(ranks: pd.DataFrame) -> Evaluation:
    """The evaluation with these ``ranks``."""
    means = (1 / ranks["rank"]).groupby(ranks["asked"]).mean()
    known, hidden, earlier = (float(means.get(kind, np.nan)) for kind in ASKED)
    return Evaluation(known, hidden, earlier, ranks)


@dataclass(frozen=True, eq=False)
class NamedEmbedding:
    """An embedding, and its rows by name; without any, they are those of a split."""

    embedding: Embedding  #: a stack of one
    entities: Mapping[str, int]
    relations: Mapping[str, int]

    def in_order(self, entities: Sequence[str], known: int, relations: Sequence[str]) -> Embedding:
        """The embedding with a row for each of ``entities``, or for the first ``known`` of them
        if it lacks all others, and for each of ``relations``. InputError if it has other rows.
        """
        theta = self.embedding
        number = theta.entity.shape[1]
        rows = _rows("entities", entities, self.entities, number, known)
        of_relations = _rows(
            "relations", relations, self.relations, theta.relation.shape[1], len(relations)
        )
        return Embedding(theta.entity[:, rows], theta.relation[:, of_relations], theta.model)


def _rows(
    kind: str, wanted: Sequence[str], row_of: Mapping[str, int], number: int, known: int
) -> Tensor:
    """Rows of ``wanted`` names, or of the ``known`` first ones, among the ``number`` rows of a
    table; shape (n,).
    """
    if number not in (known, len(wanted)):
        expected = f"expected {len(wanted)} {kind}" + f", or {known}" * (known < len(wanted))
        raise InputError("argument 'model'", "", f"{expected}, got {number}")
    if not row_of:
        return torch.arange(number)
    missing = [name for name in wanted[:number] if name not in row_of]
    if missing:
        raise InputError(
            "argument 'model'",
            "",
            f"expected the {kind} of the split: {missing[0]!r:.80} is missing",
        )
    return torch.tensor([row_of[name] for name in wanted[:number]])


def read(
    model: Any, factory: Any, entities: Any, relations: Any, options: Mapping[str, Any] | None
) -> NamedEmbedding:
    """The embedding in any form that ``HiddenSplit.evaluate`` accepts."""
    rows = getattr(model, "rows", model)  # of a result of isi.pykeen.insert
    if isinstance(rows, Inserted):
        details = rows.details
        return NamedEmbedding(details.embedding, details.names.ids, details.labels.ids)
    if isinstance(model, str | Model):
        rows = table(entities, "entities")
        checked = checked_model(model, options, rows.shape[1])
        of_relations = table(relations, "relations", checked.width(rows.shape[1]))
        return NamedEmbedding(stack_of_one(rows, of_relations, checked), {}, {})
    return _of_pykeen(model, factory)


def _of_pykeen(model: Any, factory: Any) -> NamedEmbedding:
    from pykeen.models import ERModel

    from isi.initializers.inverses import pack
    from isi.pykeen.insertion import of_result, vocabularies_of
    from isi.pykeen.reading import read_model

    model, factory, _ = of_result(model, factory, ())
    if not isinstance(model, ERModel):
        expected = "expected a model of PyKEEN's, a result of insert, or a name and tables"
        raise InputError("argument 'model'", "", f"{expected}, got {short(model)}")
    # a margin changes no rank
    embedding = read_model(model, torch.empty(0, 3, dtype=torch.int64), margin=0.0)
    embedding = pack(embedding) if model.use_inverse_triples else embedding
    if factory is None:
        return NamedEmbedding(embedding, {}, {})
    entities, relations = vocabularies_of(model, factory)
    return NamedEmbedding(embedding, entities.ids, relations.ids)


def ranks_frame(
    parts: Sequence[tuple[str, np.ndarray, np.ndarray, np.ndarray]],
) -> pd.DataFrame:
    """``Evaluation.ranks`` from parts: a kind of queries; slots of the answers, (Q,); the triples'
    labels, (Q, 3); ranks, (Q,).
    """
    import pandas as pd

    frames = [
        pd.DataFrame(labels, columns=["head", "relation", "tail"]).assign(
            asked=kind, slot=slots, rank=ranks
        )
        for kind, slots, labels, ranks in parts
    ]
    columns = ["asked", "head", "relation", "tail", "slot", "rank"]
    return pd.concat(frames, ignore_index=True)[columns]
