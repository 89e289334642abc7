"""A small graph and models of it, as PyKEEN has them."""

from typing import Any

import numpy as np
import pytest
import torch

pytest.importorskip("pykeen")

from pykeen.models import ERModel, model_resolver
from pykeen.triples import CoreTriplesFactory, TriplesFactory

ENTITIES, RELATIONS, DIMENSION = 20, 3, 8


def ring(inverse: bool = False) -> TriplesFactory:
    """A ring with all relations, and random triples; ids are not in the order of labels."""
    rng = np.random.default_rng(0)
    triples = {(e, e % RELATIONS, (e + 1) % ENTITIES) for e in range(ENTITIES)}
    triples |= {
        tuple(row) for row in rng.integers((ENTITIES, RELATIONS, ENTITIES), size=(60, 3)).tolist()
    }
    return TriplesFactory(
        torch.tensor(sorted(triples)),
        {f"e{row}": row for row in range(ENTITIES)[::-1]},
        {f"r{row}": row for row in range(RELATIONS)},
        create_inverse_triples=inverse,
    )


def model_of(name: str, known: CoreTriplesFactory, steps: int = 0, **options: Any) -> ERModel:
    """A model with its first vectors, or after so many steps of training."""
    model = model_resolver.make(
        name, triples_factory=known, embedding_dim=DIMENSION, random_seed=0, **options
    )
    model.post_parameter_update()
    learn(model, known.mapped_triples, steps)
    return model.eval()


def tables_of(model: ERModel) -> list[torch.Tensor]:
    """The first tables of a model: rows of entities, and of relations."""
    parts = model.entity_representations, model.relation_representations
    return [part[0]().detach() for part in parts]


def learn(model: ERModel, triples: torch.Tensor, steps: int) -> None:
    """Some steps on a margin loss; for few triples faster than PyKEEN."""
    rng, optimizer = torch.Generator().manual_seed(0), torch.optim.Adam(model.parameters(), lr=0.05)
    for step in range(steps):
        other = triples.clone()
        other[:, 2 * (step % 2)] = torch.randint(model.num_entities, (len(triples),), generator=rng)
        optimizer.zero_grad()
        torch.relu(1 - model.score_hrt(triples) + model.score_hrt(other)).mean().backward()
        optimizer.step()
        model.post_parameter_update()
