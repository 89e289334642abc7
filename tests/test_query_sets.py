"""Scopes and the ranks in them, against brute force with dictionaries."""

import math
from collections.abc import Callable
from dataclasses import dataclass

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from torch import Tensor

from isi.evaluation.query_sets import entity_query_sets, epoch_query_sets, novel_query_set, validation
from isi.evaluation.ranking import Result, evaluate
from isi.graph.sessions import OUT, TEST, TRAIN, VALID, Session, session_at
from isi.models.model import make_model
from isi.models.stack import Embedding
from tests.small_graphs import ANALOGY, Triple, graph_of

# Brute force, from docs/method.md alone: a triple, a split or a score is looked up, nothing is vectorized.

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
        return Session(graph_of(self.counts, self.entities, self.relations), torch.tensor(members), self.split_tensor)

    @property
    def split_tensor(self) -> Tensor:
        return torch.tensor([[split[t] for t in self.counts] for split in self.splits], dtype=torch.int8)

    def mask(self, triples: list[set[Triple]]) -> Tensor:
        return torch.tensor([[t in own for t in self.counts] for own in triples])

    def of(self, model: int, *splits: int) -> set[Triple]:
        return {triple for triple, split in self.splits[model].items() if split in splits}

    def new(self, model: int, triples: set[Triple]) -> set[Triple]:
        return {(h, r, t) for h, r, t in triples if h in self.novel[model] or t in self.novel[model]}

    def score(self, model: int) -> Score:
        entity, relation = self.embedding.entity[model].tolist(), self.embedding.relation[model].tolist()

        def score(h: int, r: int, t: int) -> float:
            (s1, s2, a, b), (r1, r2, x, y), v = entity[h], relation[r], entity[t]
            return s1 * r1 * v[0] + s2 * r2 * v[1] + (a * x - b * y) * v[2] + (b * x + a * y) * v[3]

        return score


def brute_force(
    world: World, model: int, queried: set[Triple], filtered: set[Triple], candidates: set[int]
) -> tuple[list[float], int]:
    """MRR*, entity half, relation half and MRR; and the number of competitors tied with an answer."""
    if not queried:
        return [math.nan] * 4, 0
    score = world.score(model)
    ties = 0

    def terms(answer: Triple, others: list[Triple]) -> tuple[float, float]:
        nonlocal ties
        own, best = world.counts[answer], score(*answer)
        true, predicted, plain = 1.0, 1.0, 1.0
        for competitor in others:
            if competitor == answer or competitor in filtered:
                continue
            count = world.counts.get(competitor, 0)
            ahead = 1.0 if score(*competitor) > best else 0.5 if score(*competitor) == best else 0.0
            true += count > own
            plain += ahead
            if count != own:
                predicted += ahead
                ties += ahead == 0.5
        return 1 / (abs(true - predicted) + 1), 1 / plain

    by_relation: dict[int, list[tuple[float, float]]] = {}
    relation_queries = []
    for h, r, t in queried:
        heads, tails = [(e, r, t) for e in candidates], [(h, r, e) for e in candidates]
        by_relation.setdefault(r, []).extend([terms((h, r, t), heads), terms((h, r, t), tails)])
        relation_queries.append(terms((h, r, t), [(h, other, t) for other in range(world.relations)]))
    d1 = world.of(model, TRAIN, VALID, TEST)
    weights = {r: sum(world.counts[t] for t in d1 if t[1] == r) for r in by_relation}
    halves = []
    for which in (0, 1):
        means = {r: sum(term[which] for term in own) / len(own) for r, own in by_relation.items()}
        entity = sum(weights[r] * means[r] for r in means) / sum(weights.values())
        halves.append((entity, sum(term[which] for term in relation_queries) / len(relation_queries)))
    (star_entity, star_relation), plain = halves
    return [(star_entity + star_relation) / 2, star_entity, star_relation, sum(plain) / 2], ties


def scopes(world: World, model: int) -> dict[str, tuple[set[Triple], set[Triple], set[int]]]:
    """Queries, filter and candidates of each scope, as defined in docs/method.md."""
    d1, train = world.of(model, TRAIN, VALID, TEST), world.of(model, TRAIN)
    learned, test = world.of(model, TRAIN, VALID), world.of(model, TEST)
    everyone, novel = world.members[model], set(world.novel[model])
    old = test - world.new(model, test)
    inserted = world.inserted[model]
    return {
        "all": (test, learned, everyone),
        "known": (old, learned, everyone),
        "known_closed": (old, learned, everyone - novel),
        "novel_heldout": (world.new(model, world.of(model, VALID, TEST)), train, everyone),
        "novel": (world.new(model, d1) - inserted, (learned - world.new(model, learned)) | inserted, everyone),
    }


@st.composite
def worlds(draw: st.DrawFn) -> World:
    """Two models on one graph; vectors are small whole numbers, so that ties are exact and frequent."""
    entities, relations, models = draw(st.integers(4, 6)), draw(st.integers(1, 3)), 2
    entity, relation = st.integers(0, entities - 1), st.integers(0, relations - 1)
    triple = st.tuples(entity, relation, entity)
    counts = draw(st.dictionaries(triple, st.integers(1, 3), min_size=3, max_size=30))
    size = draw(st.integers(1, 2))
    splits, members, novel, inserted = [], [], [], []
    for _ in range(models):
        out = draw(st.sets(entity, max_size=1))
        drawn = draw(
            st.lists(entity.filter(lambda e, out=out: e not in out), min_size=size, max_size=size, unique=True)
        )
        split = {t: OUT if out & {t[0], t[2]} else draw(st.sampled_from([TRAIN, VALID, TEST])) for t in counts}
        usable = [t for t, part in split.items() if part == TRAIN and (t[0] in drawn) != (t[2] in drawn)]
        splits.append(split)
        members.append(set(range(entities)) - out)
        novel.append(sorted(drawn))
        inserted.append(set(usable[::2]))
    values = st.lists(st.integers(-1, 1), min_size=models * 4 * 9, max_size=models * 4 * 9)
    table = torch.tensor(draw(values), dtype=torch.float32).view(models, 9, 4)
    embedding = Embedding(table[:, :entities].contiguous(), table[:, 6 : 6 + relations].contiguous(), ANALOGY)
    return World(counts, entities, relations, splits, members, novel, inserted, embedding)


def check(world: World, result: Result, expected: Callable[[int], tuple[set[Triple], set[Triple], set[int]]]) -> None:
    """Check a result against brute force; ``expected``: (queries, filter, candidates) by model."""
    for model in range(len(world.splits)):
        queried, filtered, candidates = expected(model)
        measures, ties = brute_force(world, model, queried, filtered, candidates)
        assert result.measures[model].tolist() == pytest.approx(measures, abs=1e-6, nan_ok=True)
        assert int(result.queries[model]) == len(queried)
        assert int(result.ties[model]) == ties


@given(worlds())
def test_query_sets_through_training_are_those_of_brute_force(world: World) -> None:
    queries = epoch_query_sets(world.session, torch.tensor(world.novel))
    results = evaluate(world.embedding, queries)
    assert set(results) == {"all", "known", "known_closed", "novel_heldout"}
    for scope, result in results.items():
        check(world, result, lambda model, scope=scope: scopes(world, model)[scope])


@given(worlds())
def test_novel_scope_is_that_of_brute_force(world: World) -> None:
    session, novel, inserted = world.session, torch.tensor(world.novel), world.mask(world.inserted)
    result = evaluate(world.embedding, novel_query_set(session, novel, inserted))["novel"]
    check(world, result, lambda model: scopes(world, model)["novel"])


@given(worlds())
def test_each_novel_entity_has_its_own_queries_of_novel_scope(world: World) -> None:
    session, novel, inserted = world.session, torch.tensor(world.novel), world.mask(world.inserted)
    for place, queries in enumerate(entity_query_sets(session, novel, inserted)):

        def own(model: int, place: int = place) -> tuple[set[Triple], set[Triple], set[int]]:
            queried, filtered, candidates = scopes(world, model)["novel"]
            entity = world.novel[model][place]
            return {t for t in queried if entity in (t[0], t[2])}, filtered, candidates

        check(world, evaluate(world.embedding, {"own": queries})["own"], own)


@given(worlds())
def test_validation_asks_the_sessions_own_triples_among_its_own_entities(world: World) -> None:
    def expected(model: int) -> tuple[set[Triple], set[Triple], set[int]]:
        return world.of(model, VALID), world.of(model, TRAIN, VALID), world.members[model]

    check(world, evaluate(world.embedding, validation(world.session))["valid"], expected)


def test_validation_of_d0_leaves_novel_entities_out() -> None:
    counts = {(0, 0, 1): 1, (2, 0, 1): 1, (3, 0, 1): 1, (0, 0, 2): 1}
    splits = torch.tensor([[TRAIN, TRAIN, VALID, VALID]], dtype=torch.int8)
    session = session_at(graph_of(counts, 4, 1), splits, torch.tensor([[[3]]]), 0)
    entity, relation = torch.tensor([[[0.0], [1.0], [2.0], [9.0]]]), torch.tensor([[[1.0]]])
    products = Embedding(entity, relation, make_model("distmult", {}, "models.distmult"))
    result = evaluate(products, validation(session))["valid"]
    # (0, 0, 2) alone is queried. All tails score 0: 0 ties, 1 is filtered, 3 is no candidate, so R_P = 1 + 1/2.
    # Heads of 2 score 0, 2, 4: R_P = 3. R_G = 1 for both.
    assert result.queries.tolist() == [1]
    assert result.measures[0, 1].item() == pytest.approx((1 / 1.5 + 1 / 3) / 2)
