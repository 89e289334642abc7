"""Scopes and the ranks in them, against brute force with dictionaries."""

import math
from collections.abc import Callable

import pytest
import torch
from hypothesis import given

from isi.evaluation.query_sets import (
    entity_query_sets,
    epoch_query_sets,
    novel_query_set,
    validation,
)
from isi.evaluation.ranking import Result, evaluate
from isi.graph.sessions import TEST, TRAIN, VALID
from tests.plain_ranks import won
from tests.small_graphs import Triple
from tests.small_worlds import World, worlds

# Brute force, from docs/method.md alone: a triple, a split or a score is looked up, nothing is
# vectorized.


def brute_force(
    world: World, model: int, queried: set[Triple], filtered: set[Triple], candidates: set[int]
) -> tuple[list[float], int]:
    """MRR*, entity half, relation half and MRR;
    and the number of competitors tied with an answer.
    """
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
            ahead = won(score(*competitor), best)
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
        relation_queries.append(
            terms((h, r, t), [(h, other, t) for other in range(world.relations)])
        )
    d1 = world.of(model, TRAIN, VALID, TEST)
    weights = {r: sum(world.counts[t] for t in d1 if t[1] == r) for r in by_relation}
    halves = []
    for which in (0, 1):
        means = {r: sum(term[which] for term in own) / len(own) for r, own in by_relation.items()}
        entity = sum(weights[r] * means[r] for r in means) / sum(weights.values())
        halves.append(
            (entity, sum(term[which] for term in relation_queries) / len(relation_queries))
        )
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
        "novel": (
            world.new(model, d1) - inserted,
            (learned - world.new(model, learned)) | inserted,
            everyone,
        ),
    }


def check(
    world: World,
    result: Result,
    expected: Callable[[int], tuple[set[Triple], set[Triple], set[int]]],
) -> None:
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
