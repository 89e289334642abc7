"""Calibrated probabilities of triples: logistic curves of the score (Platt 1999),
fitted to hidden known entities.
"""

import numpy as np
import torch
from torch import Tensor

from isi.evaluation.platt import Curves, PlattCurve, fit_platt
from isi.graph.graph import RELATION
from isi.graph.sessions import membership
from isi.initializers.context import InitContext
from isi.insertion.engine import Method
from isi.insertion.hidden import HiddenDraws

LEAST_RIGHT = 5  #: Least number of right answers for a curve.


def fit_curves(draws: HiddenDraws, method: Method) -> Curves | None:
    """Insert the hidden entities, and fit logistic curves (Platt 1999) to the answers
    to the queries about them: one for each relation with at least ``LEAST_RIGHT`` right answers.

    Given a hidden entity, all known entities are answers; given a known one, the hidden entities of
    the draw. Insert triples are left out. None with too few right answers, or if the initializer
    has no finite vectors.

    docs/insert.md has calibration errors on entities that PyKEEN never saw. One curve for
    all relations has nearly the same log loss, but fewer of its answers above .9 are right; curves
    for each direction are no better.
    """
    inserted = draws.insert(method)
    if inserted is None:
        return None
    scores, right, relations = (values.numpy() for values in answers(draws, inserted[1]))

    def fit(chosen: np.ndarray) -> PlattCurve | None:
        few = not LEAST_RIGHT <= int(right[chosen].sum()) < int(chosen.sum())
        return None if few else fit_platt(scores[chosen], right[chosen])

    of_all = fit(np.ones_like(right))
    by_relation = {
        relation: fit(relations == relation) for relation in set(relations[right].tolist())
    }
    fitted = {relation: curve for relation, curve in by_relation.items() if curve is not None}
    return None if of_all is None else Curves(fitted, of_all)


def answers(draws: HiddenDraws, vectors: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """Scores of the answers with one hidden end, whether they are right, and their relations;
    shape (N,) each.

    ``vectors``: of the hidden entities, (M, n, d). An answer to several queries, which are one
    triple, is listed once.
    """
    about, context, theta = draws.about, draws.context, draws.theta(vectors)
    # 0: the answer is a head; 1: tail
    slot, model, place = about.counted.expand(2, -1, -1).nonzero(as_tuple=True)
    other_end, relation = (
        about.answers.flip(0)[slot, model, place],
        about.triples[model, place, RELATION],
    )
    hidden = membership(context.novel, theta.entity.shape[1])[model]
    query, answer = (hidden != hidden.gather(1, other_end[:, None])).nonzero(as_tuple=True)
    ends = torch.stack([answer, other_end[query]])
    head, tail = torch.where(slot[query] == 0, ends, ends.flip(0))
    key = keys(context, model[query], head, relation[query], tail)
    first = torch.from_numpy(np.unique(key.numpy(), return_index=True)[1])
    first = first[~torch.isin(key[first], keys_of_inserted(context))]
    query, answer = query[first], answer[first]
    where = slot[query], model[query], place[query], answer
    return about.scores(theta, theta.entity)[where], about.right[where], relation[query]


def keys_of_inserted(context: InitContext) -> Tensor:
    """``keys`` of the insert triples, (I,)."""
    model, place, number = context.observed.nonzero(as_tuple=True)
    entity, is_tail = context.novel[model, place], context.novel_is_tail[model, place, number]
    other, relation = context.other[model, place, number], context.relation[model, place, number]
    return keys(
        context,
        model,
        torch.where(is_tail, other, entity),
        relation,
        torch.where(is_tail, entity, other),
    )


def keys(
    context: InitContext, model: Tensor, head: Tensor, relation: Tensor, tail: Tensor
) -> Tensor:
    """A number for each triple of a model, (T,)."""
    (_, entities, _), relations = context.theta0.entity.shape, context.theta0.relation.shape[1]
    return ((model * relations + relation) * entities + head) * entities + tail
