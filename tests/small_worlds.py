"""Random sessions as dictionaries and sets, for computations that look up a triple,
a split or a score at a time.
"""

from collections.abc import Callable
from dataclasses import dataclass

import torch
from hypothesis import strategies as st
from torch import Tensor

from isi.graph.sessions import OUT, TEST, TRAIN, VALID, Session
from isi.models.stack import Embedding
from tests.small_graphs import ANALOGY, Triple, graph_of

Score = Callable[[int, int, int], float]


@dataclass(frozen=True)
class World:
    """A graph, and for each model the data of its sessions."""

    counts: dict[Triple, int]
    entities: int
    relations: int
    splits: list[dict[Triple, int]]
    members: list[set[int]]
    novel: list[list[int]]
    inserted: list[set[Triple]]
    embedding: Embedding

    @property
    def session(self) -> Session:
        members = [[e in own for e in range(self.entities)] for own in self.members]
        return Session(
            graph_of(self.counts, self.entities, self.relations),
            torch.tensor(members),
            self.split_tensor,
        )

    @property
    def split_tensor(self) -> Tensor:
        return torch.tensor(
            [[split[t] for t in self.counts] for split in self.splits], dtype=torch.int8
        )

    @property
    def given(self) -> tuple[Session, Tensor, Tensor]:
        """D¹, the ids of novel entities and the mask of insert triples."""
        inserted = [[triple in own for triple in self.counts] for own in self.inserted]
        return self.session, torch.tensor(self.novel), torch.tensor(inserted)

    def of(self, model: int, *splits: int) -> set[Triple]:
        return {triple for triple, split in self.splits[model].items() if split in splits}

    def score(self, model: int) -> Score:
        entity, relation = (
            self.embedding.entity[model].tolist(),
            self.embedding.relation[model].tolist(),
        )

        def score(h: int, r: int, t: int) -> float:
            (s1, s2, a, b), (r1, r2, x, y), v = entity[h], relation[r], entity[t]
            return s1 * r1 * v[0] + s2 * r2 * v[1] + (a * x - b * y) * v[2] + (b * x + a * y) * v[3]

        return score


@st.composite
def worlds(draw: st.DrawFn) -> World:
    """Two models on one graph; vectors are small whole numbers,
    so that ties are exact and frequent.
    """
    entities, relations, models = draw(st.integers(4, 6)), draw(st.integers(1, 3)), 2
    entity, relation = st.integers(0, entities - 1), st.integers(0, relations - 1)
    triple = st.tuples(entity, relation, entity)
    counts = draw(st.dictionaries(triple, st.integers(1, 3), min_size=3, max_size=30))
    size = draw(st.integers(1, 2))
    splits, members, novel, inserted = [], [], [], []
    for _ in range(models):
        out = draw(st.sets(entity, max_size=1))
        drawn = draw(
            st.lists(
                entity.filter(lambda e, out=out: e not in out),
                min_size=size,
                max_size=size,
                unique=True,
            )
        )
        split = {
            t: OUT if out & {t[0], t[2]} else draw(st.sampled_from([TRAIN, VALID, TEST]))
            for t in counts
        }
        usable = [
            t for t, part in split.items() if part != OUT and (t[0] in drawn) != (t[2] in drawn)
        ]
        splits.append(split)
        members.append(set(range(entities)) - out)
        novel.append(sorted(drawn))
        inserted.append(set(usable[::2]))
    values = st.lists(st.integers(-1, 1), min_size=models * 4 * 9, max_size=models * 4 * 9)
    table = torch.tensor(draw(values), dtype=torch.float32).view(models, 9, 4)
    embedding = Embedding(
        table[:, :entities].contiguous(), table[:, 6 : 6 + relations].contiguous(), ANALOGY
    )
    return World(counts, entities, relations, splits, members, novel, inserted, embedding)
