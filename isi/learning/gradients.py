"""The gradient of the loss of a batch, in either form, for whatever family."""

from __future__ import annotations

from dataclasses import replace

import torch

from isi.embeddings import bits
from isi.embeddings.stack import Embedding
from isi.embeddings.triples import Every
from isi.learning.batches import Lists, Tables


def loss_gradient(embedding: Embedding, batch: Tables | Lists) -> Embedding:
    """Gradient of Σ -log σ(y · f) over a batch (section 3)."""
    entity, relation, family = embedding.entity, embedding.relation, embedding.family
    if isinstance(batch, Tables):
        scores, pull = family.scores(entity, relation, Every.of(entity, relation))
        slope = torch.sigmoid_(scores).mul_(batch.positives + batch.negatives).sub_(batch.positives)
    else:
        scores, pull = family.scores(entity, relation, batch.triples)
        slope = bits.padded(torch.sigmoid, scores) - batch.positive
    by_entity, by_relation = pull(slope)
    return replace(embedding, entity=by_entity, relation=by_relation)
