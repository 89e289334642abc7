"""ANALOGY (Liu et al. 2017): normal, commuting linear maps as relations (section 2).

Of the d coordinates of a vector the first d/2 are scalars; the others are the a-halves, then the
b-halves, of d/4 blocks. A relation holds one factor for each scalar and, at the places of a and b,
the x and y of the block ``[[x, y], [-y, x]]`` (rows times columns). With ``swap`` exchanging a and b,

    vᵀW = v ⊙ (r, x, x) + swap(v) ⊙ (0, -y, y)

so that a map costs two products, whatever it does with its result.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from isi.embeddings.stack import Embedding

#: Smallest |r| of a scalar and smallest x² + y² of a block by which ``inverse`` divides.
CLAMP = 1e-6


def transform(vectors: Tensor, relation: Tensor) -> Tensor:
    """vᵀW; shapes (..., d), broadcast against each other."""
    straight, crossed = _factors(relation)
    return torch.addcmul(vectors * straight, swap(vectors), crossed)


def transpose(relation: Tensor) -> Tensor:
    """The relation whose map is Wᵀ: the y of each block changes its sign; shape (..., d)."""
    scalars, x, y = _parts(relation)
    return torch.cat([scalars, x, -y], -1)


def inverse(relation: Tensor) -> Tensor:
    """The relation whose map is W⁻¹, with |r| and x² + y² clamped to at least ``CLAMP``; shape (..., d)."""
    scalars, x, y = _parts(relation)
    sign = torch.where(scalars < 0, -1.0, 1.0)
    norm = (x * x + y * y).clamp(min=CLAMP)
    return torch.cat([sign / scalars.abs().clamp(min=CLAMP), x / norm, -y / norm], -1)


def score(head: Tensor, relation: Tensor, tail: Tensor) -> Tensor:
    """f(h, r, t) = ⟨vₕᵀW, vₜ⟩ of triples (section 2); shapes (..., d), result (...)."""
    return (transform(head, relation) * tail).sum(-1)


def score_tails(embedding: Embedding, head: Tensor, relation: Tensor) -> Tensor:
    """Scores of all entities as tail of (h, r, ?); ids of shape (M, Q), result (M, Q, E)."""
    mapped = transform(_rows(embedding.entity, head), _rows(embedding.relation, relation))
    return mapped @ embedding.entity.mT


def score_heads(embedding: Embedding, relation: Tensor, tail: Tensor) -> Tensor:
    """Scores of all entities as head of (?, r, t); ids of shape (M, Q), result (M, Q, E)."""
    mapped = transform(_rows(embedding.entity, tail), transpose(_rows(embedding.relation, relation)))
    return mapped @ embedding.entity.mT


def score_relations(embedding: Embedding, head: Tensor, tail: Tensor) -> Tensor:
    """Scores of all relations of (h, ?, t); ids of shape (M, Q), result (M, Q, R)."""
    heads, tails = _rows(embedding.entity, head), _rows(embedding.entity, tail)
    return score(heads[:, :, None], embedding.relation[:, None], tails[:, :, None])


def score_all(embedding: Embedding) -> tuple[Tensor, Tensor]:
    """Scores of every triple, (M, R, E, E), and the vₕᵀW that they come from, (M, R, E, d).

    Both are views that leave a row out at the end of each model. PyTorch then runs over them model by
    model, where it would run over a solid stack as one array, whose last few numbers it rounds
    otherwise than the rest: so a model's bits would depend on its place in the stack.
    """
    (models, entities, dimension), relations = embedding.entity.shape, embedding.relation.shape[1]
    rows = embedding.entity.new_zeros(models, relations * entities + 1, dimension)
    mapped = rows[:, :-1].view(models, relations, entities, dimension)
    straight, crossed = _factors(embedding.relation[:, :, None])
    torch.mul(embedding.entity[:, None], straight, out=mapped).addcmul_(swap(embedding.entity)[:, None], crossed)
    scores = torch.bmm(rows, embedding.entity.mT)[:, :-1]
    return scores.view(models, relations, entities, entities), mapped


def gradient(embedding: Embedding, mapped: Tensor, slope: Tensor) -> Embedding:
    """Gradient of Σ slope · f over all triples.

    Args:
        embedding: where to take it.
        mapped: vₕᵀW of every head and relation, as ``score_all`` gives it; shape (M, R, E, d).
        slope: derivative by the score of each triple; shape (M, R, E, E).
    """
    models, relations, entities, dimension = mapped.shape
    flat = slope.view(models, relations * entities, entities)
    pulled = torch.bmm(flat, embedding.entity).view_as(mapped)  # by vₕᵀW
    entity = torch.bmm(flat.mT, mapped.view(models, relations * entities, dimension))  # as tails
    straight, crossed = _factors(embedding.relation[:, :, None])
    entity += (pulled * straight).sum(1) + swap((pulled * crossed).sum(1))  # as heads
    by_straight = (pulled * embedding.entity[:, None]).sum(2)
    by_crossed = (pulled * swap(embedding.entity)[:, None]).sum(2)
    return Embedding(entity, _by_factors(by_straight, by_crossed))


@dataclass(frozen=True)
class Rows:
    """What N listed triples take from the tables of a stack; shapes: (N, d)."""

    #: vectors of the heads, and the same swapped
    heads: Tensor
    swapped: Tensor
    #: the two factors of the relations' maps
    straight: Tensor
    crossed: Tensor
    tails: Tensor
    #: vₕᵀW
    mapped: Tensor


def score_listed(
    embedding: Embedding, model: Tensor, head: Tensor, relation: Tensor, tail: Tensor
) -> tuple[Tensor, Rows]:
    """Scores of listed triples of the models of a stack, and what they come from; ids and scores of shape (N,)."""
    entity, (straight, crossed) = embedding.entity, _factors(embedding.relation)
    heads, tails = _gather(entity, model, head), _gather(entity, model, tail)
    straight, crossed = _gather(straight, model, relation), _gather(crossed, model, relation)
    swapped = _gather(swap(entity), model, head)
    mapped = torch.addcmul(heads * straight, swapped, crossed)
    return (mapped * tails).sum(-1), Rows(heads, swapped, straight, crossed, tails, mapped)


def gradient_listed(
    embedding: Embedding, rows: Rows, model: Tensor, head: Tensor, relation: Tensor, tail: Tensor, slope: Tensor
) -> Embedding:
    """Gradient of Σ slope · f over listed triples; ids and slope of shape (N,).

    Args:
        rows: as ``score_listed`` gives them for the same embedding and ids.
        slope: derivative by the score of each triple.
    """
    (models, entities, dimension), relations = embedding.entity.shape, embedding.relation.shape[1]

    def summed(values: Tensor, ids: Tensor, number: int) -> Tensor:
        table = values.new_zeros(models * number, dimension).index_add_(0, model * number + ids, values)
        return table.view(models, number, dimension)

    pulled = rows.tails * slope[:, None]  # by vₕᵀW
    entity = summed(rows.mapped * slope[:, None], tail, entities)
    entity += summed((pulled * rows.straight).add_(swap(pulled * rows.crossed)), head, entities)
    by_straight = summed(pulled * rows.heads, relation, relations)
    by_crossed = summed(pulled * rows.swapped, relation, relations)
    return Embedding(entity, _by_factors(by_straight, by_crossed))


def resultants(known: Tensor, relation: Tensor, novel_is_tail: Tensor) -> Tensor:
    """α of insert triples: where each puts the novel entity (equation 4).

    Args:
        known: vector of the known end; shape (..., d).
        relation: of the triple; shape (..., d).
        novel_is_tail: vₕᵀW where true, vₜᵀW⁻¹ where the novel entity is the head; shape (...).
    """
    return transform(known, torch.where(novel_is_tail[..., None], relation, inverse(relation)))


def swap(vectors: Tensor) -> Tensor:
    """Exchange the a- and b-halves of the blocks; scalars stay. Shape (..., d)."""
    scalars, a, b = _parts(vectors)
    return torch.cat([scalars, b, a], -1)


def _parts(vectors: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    quarter = vectors.shape[-1] // 4
    return vectors[..., : 2 * quarter], vectors[..., 2 * quarter : 3 * quarter], vectors[..., 3 * quarter :]


def _factors(relation: Tensor) -> tuple[Tensor, Tensor]:
    scalars, x, y = _parts(relation)
    return torch.cat([scalars, x, x], -1), torch.cat([torch.zeros_like(scalars), -y, y], -1)


def _by_factors(straight: Tensor, crossed: Tensor) -> Tensor:
    """Gradient by a relation from those by its two factors (see ``_factors``); shape (..., d)."""
    scalars, straight_a, straight_b = _parts(straight)
    _, crossed_a, crossed_b = _parts(crossed)
    return torch.cat([scalars, straight_a + straight_b, crossed_b - crossed_a], -1)


def _rows(table: Tensor, ids: Tensor) -> Tensor:
    """Rows of each model's table; shapes (M, N, d) and (M, Q), result (M, Q, d)."""
    return table.gather(1, ids[..., None].expand(-1, -1, table.shape[-1]))


def _gather(table: Tensor, model: Tensor, ids: Tensor) -> Tensor:
    """Rows of a stack of tables, one for each of a list; shapes (M, N, d), (L,) and (L,), result (L, d)."""
    return table.flatten(0, 1).index_select(0, model * table.shape[1] + ids)
