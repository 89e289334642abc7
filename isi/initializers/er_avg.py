"""ERAvg (Albooyeh et al. 2020): the centre of what the insert triples name, taken through their relations."""

from __future__ import annotations

from dataclasses import replace

import torch

from isi.initializers import initializer
from isi.insertion.core import NONE, Initial, Insertion
from isi.insertion.evidence import anchors, told
from isi.insertion.similarity import everyone_known, first_that_can, has_insert_triples


@initializer("er_avg", label="ERAvg", role="baseline", colour="#9467bd")
def entity_relation_average(insertion: Insertion) -> Initial:
    """Mean over the insert triples of where their known ends meet the novel one; the centroid where there are none."""
    weights, able = told(insertion).flatten(2), has_insert_triples(insertion)
    mean = weights @ anchors(insertion.theta0) / weights.sum(-1, keepdim=True).clamp(min=1)
    otherwise = first_that_can(insertion, (NONE, able, everyone_known(insertion)))
    return replace(otherwise, vectors=torch.where(able[..., None], mean, otherwise.vectors), indicators=None)
