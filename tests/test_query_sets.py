"""The measure and its changes, against loops over dictionaries."""

import math
from dataclasses import dataclass

import pandas as pd
import pytest
from hypothesis import given, settings

from isi.evaluation.changes import CHANGES, change_rows, changed_query_sets, with_weighted_changes
from isi.evaluation.query_sets import query_sets, validation, with_weighted
from isi.evaluation.ranking import MEASURES, evaluate, measure_rows
from isi.graph.sessions import TEST, TRAIN, VALID
from stages.grid import known_shares
from tests.plain_ranks import won
from tests.small_graphs import Triple, points_of, random_graph
from tests.small_worlds import World, worlds


@dataclass(frozen=True)
class Asked:
    """Queries of one model: how often each triple is asked, the filters and the candidates."""

    times: dict[Triple, int]
    filtered: set[Triple]  #: for MRR*
    true: set[Triple]  #: for MRR
    candidates: set[int]
    alike: bool = False  #: whether triples weigh alike, whatever their relation


def mean(values: list[float]) -> float:
    return sum(values) / len(values)


def measures(world: World, model: int, asked: Asked) -> list[float]:
    """``MEASURES``: a triple, a split or a score is looked up, nothing is vectorized."""
    if not asked.times:
        return [math.nan] * len(MEASURES)
    score = world.score(model)

    def terms(answer: Triple, others: list[Triple]) -> tuple[float, float]:
        """The term of MRR* and the reciprocal rank."""
        own, best = world.counts[answer], score(*answer)
        true, predicted, plain = 1.0, 1.0, 1.0
        for competitor in others:
            if competitor == answer:
                continue
            count, above = world.counts.get(competitor, 0), won(score(*competitor), best)
            if competitor not in asked.filtered:
                true += count > own
                predicted += above * (count != own)
            if competitor not in asked.true:
                plain += above
        return 1 / (abs(true - predicted) + 1), 1 / plain

    of_ends, of_relations = dict[int, list[tuple[float, float]]](), list[tuple[float, float]]()
    for (h, r, t), times in asked.times.items():
        heads, tails = (
            [(e, r, t) for e in asked.candidates],
            [(h, r, e) for e in asked.candidates],
        )
        own = [terms((h, r, t), heads), terms((h, r, t), tails)]
        of_ends.setdefault(r, []).extend(own * times)
        relations = [(h, other, t) for other in range(world.relations)]
        of_relations += [terms((h, r, t), relations)] * times
    d1 = world.of(model, TRAIN, VALID, TEST)
    observed = {r: sum(world.counts[t] for t in d1 if t[1] == r) for r in of_ends}
    if asked.alike:
        observed = {r: len(own) for r, own in of_ends.items()}
    result = list[float]()
    for which in (0, 1):
        means = {r: mean([term[which] for term in own]) for r, own in of_ends.items()}
        entity = sum(observed[r] * means[r] for r in means) / sum(observed.values())
        relation = mean([term[which] for term in of_relations])
        result += [(entity + relation) / 2, entity, relation]
    return result


def expected(world: World, model: int) -> dict[str, Asked]:
    """The query sets as docs/method.md defines them."""
    novel, everyone = set(world.novel[model]), world.members[model]
    d1, test = world.of(model, TRAIN, VALID, TEST), world.of(model, TEST)
    train, learned = world.of(model, TRAIN), world.of(model, TRAIN, VALID)
    left = d1 - world.inserted[model]  # no query asks for insert triples
    new = {triple for triple in d1 if {triple[0], triple[2]} & novel}
    known = dict.fromkeys(test - new, 1)
    observed = {triple: world.counts[triple] if triple in train else 1 for triple in left}
    of_novel = {triple: times for triple, times in observed.items() if triple in new}
    held_out = dict.fromkeys((d1 - train) & new & left, 1)
    sets = {
        "known": Asked(known, learned - new, d1, everyone),
        "known_closed": Asked(known, learned - new, d1, everyone - novel),
        "novel": Asked(of_novel, learned - new, d1, everyone),
        "held_out": Asked(dict.fromkeys(test & left, 1), learned, d1, everyone),
        "novel_held_out": Asked(held_out, train, d1, everyone),
        "d1": Asked(observed, d1, d1, everyone),
    }
    for group, times in (("known", known), ("novel", of_novel)):
        sets[f"{group}_learned"] = Asked(times, learned - new, learned - new, everyone)
        sets[f"{group}_alike"] = Asked(times, d1, d1, everyone, alike=True)
    return sets


#: The query sets of each change, by group, and the measure taken of them.
GROUPS = ("known", "novel")
OF_CHANGES = {
    "none": ("{}", "mrr"),
    "counts": ("{}", "mrr_star"),
    "filter": ("{}_learned", "mrr"),
    "one_group": ("d1", "mrr"),
    "triples_alike": ("{}_alike", "mrr"),
    "entities_alone": ("{}", "mrr_entity"),
}


@settings(max_examples=30)
@given(worlds())
def test_the_measure_and_its_changes_are_those_of_plain_loops(world: World) -> None:
    results = evaluate(world.embedding, query_sets(*world.given))
    results |= evaluate(world.embedding, changed_query_sets(*world.given))
    rows = change_rows(measure_rows(results)).set_index(["change", "scope", "place"])["value"]
    compared = 0
    for model in range(len(world.splits)):
        asked = expected(world, model)
        plain = {name: measures(world, model, own) for name, own in asked.items()}
        assert plain.keys() == results.keys()
        for name, result in results.items():
            found = result.measures[model].tolist()
            assert found == pytest.approx(plain[name], abs=1e-6, nan_ok=True), name
            assert int(result.queries[model]) == len(asked[name].times)
        for change, (name, measure) in OF_CHANGES.items():
            for scope in ("weighted",) if name == "d1" else GROUPS:
                own = plain[name.format(scope)][MEASURES.index(measure)]
                found = rows[change, scope, model]
                assert found == pytest.approx(own, abs=1e-6, nan_ok=True), change
                compared += 1
    assert compared == len(rows)
    assert OF_CHANGES.keys() == CHANGES.keys()


@given(worlds())
def test_validation_asks_the_sessions_own_triples_among_its_own_entities(world: World) -> None:
    result = evaluate(world.embedding, validation(world.session))["valid"]
    for model in range(2):
        valid, seen = world.of(model, VALID), world.of(model, TRAIN, VALID)
        asked = Asked(dict.fromkeys(valid, 1), seen, seen, world.members[model])
        plain = measures(world, model, asked)
        assert result.measures[model].tolist() == pytest.approx(plain, abs=1e-6, nan_ok=True)


def test_the_share_of_known_is_that_of_the_mean_numbers_of_unique_triples() -> None:
    graph = random_graph(14, 2, 60)
    grid = [points_of(graph, 1, [0, 1]), points_of(graph, 3, [0, 1]), points_of(graph, 3, [2])]
    number = {1: [0, 0], 3: [0, 0]}
    for points in grid:
        for splits, novel in zip(points.splits, points.novel.tolist(), strict=True):
            for (head, _, tail), code in zip(graph.triples.tolist(), splits, strict=True):
                is_novel = bool({head, tail} & {*novel})
                number[points.size][is_novel] += is_novel or code == TEST
    assert known_shares(grid) == {
        size: known / (known + new) for size, (known, new) in number.items()
    }


def test_weighted_takes_the_share_of_its_size_and_is_null_without_one_of_the_groups() -> None:
    rows = [
        (size, seed, scope, value, queries)
        for size, seed, known, novel in ((1, 0, 0.8, 0.4), (2, 0, 0.8, 0.4), (2, 1, 0.8, None))
        for scope, value, queries in (
            ("novel", novel, 3 if novel else 0),
            ("known_closed", 0.9, 5),
            ("known", known, 5),
        )
    ]
    frame = pd.DataFrame(rows, columns=["size", "seed", "scope", "value", "queries"])
    shares = {1: 0.75, 2: 0.5}
    runs = frame.drop(columns="value").assign(**dict.fromkeys(MEASURES, frame["value"]))
    whole = with_weighted(runs, shares)
    pd.testing.assert_frame_equal(whole[: len(runs)], runs)
    found = whole[whole["scope"] == "weighted"].set_index(["size", "seed"])
    assert found["queries"].tolist() == [8, 8, 0]
    changes = frame[frame["scope"] != "known_closed"].drop(columns="queries").assign(change="none")
    rows_of_changes = with_weighted_changes(changes, shares).query("scope == 'weighted'")
    for values in (*(found[name] for name in MEASURES), rows_of_changes["value"]):
        assert values.tolist() == pytest.approx([0.7, 0.6, math.nan], nan_ok=True)
