"""Input of initializers (``InitContext``) from plain lists: one model with four novel entities."""

from collections.abc import Sequence
from dataclasses import replace

import torch
from torch import Tensor

from isi.config import Option
from isi.initializers.api import FALLBACKS, INITIALIZERS, InitResult
from isi.initializers.context import InitContext
from isi.models.model import Model, make_model
from isi.models.stack import Embedding
from tests.small_graphs import ANALOGY, random_embedding

ENTITIES, RELATIONS, DIMENSION = 12, 3, 8
#: Training triples of ``four_novel``; the mean number per entity is 2 · 10 / 8 = 2.5.
TRIPLES = [
    (1, 0, 2),
    (1, 0, 3),
    (2, 0, 1),
    (3, 1, 4),
    (4, 1, 6),
    (6, 1, 7),
    (7, 2, 8),
    (8, 2, 10),
    (10, 2, 1),
    (3, 2, 1),
]
#: The known entities of ``four_novel``.
KNOWN = (1, 2, 3, 4, 6, 7, 8, 10)
LINEAR = ("analogy", "complex", "distmult")
DISTANCES: list[tuple[str, dict[str, Option]]] = [
    (name, {"margin": margin, "squared": squared})
    for name, margin in (("transe", 2.0), ("rotate", 4.0))
    for squared in (True, False)
]
_MAP: dict[str, Option] = {"strength": 0.5, "ratio": 3}
#: All initializers that ship, with options.
EVERYONE: dict[str, dict[str, Option]] = {
    "xavier": {},
    "iu": {},
    "es": {"k": 3},
    "rs": {"k": 4},
    "ers": {"k": 2, "candidates": 5},
    "mean": {},
    "kind_mean": {},
    "gaussian": {},
    "es_permuted": {"k": 3},
    "er_avg": {},
    "soft_es": {"temperature": 0.2},
    "soft_rs": {"temperature": 0.1},
    "soft_hybrid": {"word_weight": 4.0, "relation_weight": 6.0},
    "map_own_facts": {"word_weight": 4.0, "relation_weight": 6.0, **_MAP},
    "map": {"word_weight": 4.0, "relation_weight": 6.0, **_MAP, "known_negatives": 2.0},
}
#: An insert triple: the known end, the relation, and whether the novel entity is the tail.
Seen = tuple[int, int, bool]


def model_named(name: str, **options: Option) -> Model:
    return make_model(name, options, f"models.{name}")


def fallbacks(result: InitResult) -> list[str | None]:
    return [FALLBACKS[code] for code in result.fallback[0].tolist()]


def initialize(name: str, context: InitContext, **options: Option) -> InitResult:
    return INITIALIZERS.get(name, "initializers").initialize(context, options)


def insertion(
    theta0: Embedding,
    novel: Sequence[int],
    seen: Sequence[Sequence[Seen]],
    words: Tensor,
    kinds: Sequence[int],
    triples: Sequence[tuple[int, int, int]] = (),
) -> InitContext:
    """A context of one model: rows of novel entities become zero;
    all other entities are known and eligible.

    ``triples``: the training triples of D⁰.
    """
    known = torch.ones(1, len(kinds), dtype=torch.bool)
    known[0, list(novel)] = False
    longest = max([1, *map(len, seen)])
    padded = torch.tensor([[*own, *[(0, 0, False)] * (longest - len(own))] for own in seen]).long()[
        None
    ]
    return InitContext(
        theta0=replace(theta0, entity=theta0.entity * known[..., None]),
        known=known,
        eligible=known,
        novel=torch.tensor([list(novel)]),
        words=words,
        kinds=torch.tensor(kinds),
        other=padded[..., 0],
        relation=padded[..., 1],
        novel_is_tail=padded[..., 2] == 1,
        observed=torch.tensor([[place < len(own) for place in range(longest)] for own in seen])[
            None
        ],
        triples=torch.tensor(triples, dtype=torch.int64).view(-1, 3),
        trained=torch.ones(1, len(triples)) > 0,
        root=0,
        keys=torch.tensor([[2, 0]]),
    )


def four_novel(of: Model = ANALOGY) -> InitContext:
    """Novel entities: 0 with 4 insert triples as head and tail, 5 with one, 9 with none,
    11 without a word vector.
    """
    words = torch.randn(ENTITIES, 6, generator=torch.Generator().manual_seed(1))
    words[11] = 0
    seen: list[list[Seen]] = [
        [(1, 0, False), (2, 0, False), (3, 2, False), (4, 1, True)],
        [(7, 1, True)],
        [],
        [(2, 1, False), (6, 1, True)],
    ]
    theta0 = random_embedding(1, ENTITIES, RELATIONS, DIMENSION, model=of)
    return insertion(
        theta0, [0, 5, 9, 11], seen, words, [0, 0, 0, 0, 1, 1, 1, 1, 2, 2, 3, 3], TRIPLES
    )
