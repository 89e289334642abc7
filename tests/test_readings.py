"""Readings of the paper's metric against values by hand, the product's metric and loops,
and the stage for them.
"""

import math
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
import torch
import yaml
from hypothesis import given, settings
from torch import Tensor

from isi.analyses.readings import ANSWERS, RANKS, READING_CURVES, READINGS, ReadingWatch
from isi.evaluation import readings
from isi.evaluation.query_sets import epoch_query_sets
from isi.evaluation.ranking import evaluate
from isi.evaluation.readings import Reading, ReadingQueries, places_of, rank_all, reading_queries
from isi.experiment.grid import GridPoints
from isi.graph.sessions import TEST, TRAIN, VALID, Session, session_of
from isi.models.stack import Embedding, select
from isi.tables import paths
from tests import stage_run
from tests.beyond_entries import READING_CASE, list_entries
from tests.plain_ranks import won
from tests.small_graphs import ANALOGY, Triple, graph_of, points_of, random_embedding, random_graph
from tests.small_worlds import World, worlds
from tools.verify import Check, check_readings


def measured(embedding: Embedding, session: Session, novel: Tensor) -> Tensor:
    """MRR* under every reading; shape: (M, readings)."""
    queries = reading_queries(session, novel)
    return readings.values(rank_all(embedding, queries), queries)


def of_points(points: GridPoints, embedding: Embedding) -> Tensor:
    return measured(embedding, points.session(1), points.novel_in(1))


def test_a_name_lists_the_choices_and_a_reading_has_neighbours_that_differ_in_one() -> None:
    names = [reading.name for reading in readings.readings()]
    assert len(set(names)) == len(names) == 4 * 4 * 3 * 3 * 3 * 2
    assert [Reading.of(name) for name in names] == list(readings.readings())
    assert Reading().name == "test any relation halves learned all"
    assert places_of([names[7], names[0]]) == [7, 0]
    assert len(Reading().neighbours) == 3 + 3 + 2 + 2 + 2 + 1
    assert Reading.of("test both relation halves learned all") in Reading().neighbours


#: The triples A, B, C and D: count and split of each. The entity 3 is novel, so C alone is about a
#: novel entity.
TRIPLES: dict[Triple, tuple[int, int]] = {
    (0, 0, 1): (1, TRAIN),
    (0, 0, 2): (2, TEST),
    (0, 0, 3): (3, TEST),
    (1, 1, 2): (7, VALID),
}
#: f(h, r, t) = h · r · t. The tails 0, 1, 2, 3 of (0, 0, ?) score 1, 4, 3, 2, and 0 is the lowest
#: head.
VECTORS = [1.0, 4.0, 3.0, 2.0], [1.0, 2.0]
# Terms of MRR*, by ranking where it matters:
#           head   relation  tail: none, all  learned, all  true, all  none, split  learned, split
# A          1/4        1/2          1/3          1/3        1          1             1
# B          1/4        1/2            1          1/2        1        1/2             1
# C          1/4        1/2          1/3          1/2        1        1/2             1
# D            1          1          1/2          1/2      1/2        1/2           1/2
# B's tail 2: R_G = 2 (C), R_P = 2 (1); without A, R_P = 1; without C, too, R_G = 1. In its split, C
# counts as B does.
BY_HAND = {
    "test any triple alike learned all": (1 / 4 + 1 / 2 + 1 / 2) / 3,
    "test any relation halves learned all": ((1 / 4 + 1 / 2) / 2 + 1 / 2) / 2,
    "test any triple entities none all": (1 / 4 + (1 + 1 / 3) / 2) / 2,
    "test any observations entities none all": (1 / 4 + (2 * 1 + 3 * 1 / 3) / 5) / 2,
    "test known triple entities none all": (1 / 4 + 1) / 2,
    "test novel triple entities none all": (1 / 4 + 1 / 3) / 2,
    "test both triple entities none all": (1 / 4 + (1 + 1 / 3) / 2) / 2,
    "test any triple entities true all": (1 / 4 + 1) / 2,
    "test any triple entities none split": (1 / 4 + 1 / 2) / 2,
    "test any triple entities learned split": (1 / 4 + 1) / 2,
    "train any triple entities learned all": (1 / 4 + 1 / 3) / 2,
    "train any triple entities learned split": (1 / 4 + 1) / 2,
    "train novel triple entities learned all": math.nan,
    # relation 0 has 6 observations and the queries B and C, relation 1 has 7 and D
    "held_out any relation entities none all": (
        (3 / 4 + 3 / 4 + 7) / 13 + (3 * 1 + 3 / 3 + 7 / 2) / 13
    )
    / 2,
    # a query for a relation weighs as any other
    "held_out any relation halves none all": (8 / 13 + (1 / 2 + 1 / 2 + 1) / 3) / 2,
    "all any triple halves none split": (7 / 16 + 5 / 8) / 4 + 5 / 8 / 2,
    "all any observations alike learned all": (
        (6 / 4 + 7) + (1 / 3 + 2 / 2 + 3 / 2 + 7 / 2) + (6 / 2 + 7)
    )
    / 13
    / 3,
}


@pytest.mark.parametrize("name", BY_HAND)
def test_readings_by_hand(name: str) -> None:
    session = session_of(
        graph_of({triple: count for triple, (count, _) in TRIPLES.items()}, 4, 2),
        torch.tensor([[split for _, split in TRIPLES.values()]], dtype=torch.int8),
    )
    entity, relation = (torch.tensor([[[value, 0, 0, 0] for value in table]]) for table in VECTORS)
    (values,) = measured(Embedding(entity, relation, ANALOGY), session, torch.tensor([[3]]))
    assert values[places_of([name])].item() == pytest.approx(BY_HAND[name], nan_ok=True)


SEEDS, LAST = [0, 1, 2, 3, 4], 6
POINTS = points_of(random_graph(13, 3, 80), 2, SEEDS)


@pytest.mark.parametrize("seed", range(5))
def test_two_readings_are_the_metric_of_the_product(seed: int) -> None:
    points = points_of(random_graph(13, 3, 80, seed), 2, SEEDS)
    embedding = random_embedding(len(SEEDS), 13, 3, 8, seed)
    values = of_points(points, embedding)
    results = evaluate(embedding, epoch_query_sets(points.session(1), points.novel_in(1)))
    for about, scope in (("any", "all"), ("known", "known")):
        (place,) = places_of([f"test {about} relation halves learned all"])
        torch.testing.assert_close(
            values[:, place], results[scope].measures[:, 0], rtol=0, atol=1e-6, equal_nan=True
        )


def part_of(points: GridPoints, models: list[int]) -> GridPoints:
    """Some models of grid points."""
    seeds = [points.seeds[model] for model in models]
    return GridPoints(
        points.experiment,
        points.graph,
        points.size,
        seeds,
        points.splits[models],
        points.novel[models],
    )


@pytest.mark.parametrize("models", [[0], [2], [4], [1, 3], [3, 0, 2]])
def test_no_bit_depends_on_the_other_models_of_a_stack_or_on_pieces(
    models: list[int], monkeypatch: pytest.MonkeyPatch
) -> None:
    splits = POINTS.splits.copy()
    for model in range(len(SEEDS)):  # so that numbers of queries differ
        splits[model, : 9 * model] = -1
    points = GridPoints("home", POINTS.graph, 2, SEEDS, splits, POINTS.novel)
    embedding = random_embedding(len(SEEDS), 13, 3, 8)
    whole, chosen = of_points(points, embedding)[models], select(embedding, torch.tensor(models))
    part = of_points(part_of(points, models), chosen)
    monkeypatch.setattr("isi.evaluation.ranks.BUDGET", 2 * 13 * 7)  # few queries at a time
    pieces = of_points(part_of(points, models), chosen)
    assert whole.isnan().any() < whole.isfinite().any()
    for other in (part, pieces):
        assert torch.equal(whole.nan_to_num(-1), other.nan_to_num(-1))


# Loops, from the words of ``isi.evaluation.readings`` alone

SPLITS = {"test": {TEST}, "held_out": {VALID, TEST}, "all": {TRAIN, VALID, TEST}, "train": {TRAIN}}
FILTERED = {"learned": {TRAIN, VALID}, "true": {TRAIN, VALID, TEST}, "none": set[int]()}
SHARES = {
    "alike": (1 / 3, 1 / 3, 1 / 3),
    "entities": (1 / 2, 0, 1 / 2),
    "halves": (1 / 4, 1 / 2, 1 / 4),
}
#: Terms of MRR* by filter, truth, queried triple and place of the hidden slot.
Terms = dict[tuple[str, str, Triple, int], float]


def terms_of(world: World, model: int) -> Terms:
    splits, score, terms = world.splits[model], world.score(model), Terms()
    for filtering, truth, answer, slot in product(
        FILTERED, ("all", "split"), d1_of(world, model), range(3)
    ):

        def count(triple: Triple, truth: str = truth, answer: Triple = answer) -> int:
            number = world.counts.get(triple, 0)
            if truth == "all" or not number:
                return number
            return (
                (number if splits[triple] == TRAIN else 1)
                if splits[triple] == splits[answer]
                else 0
            )

        true, predicted = 1.0, 1.0
        for candidate in sorted(world.members[model]) if slot != 1 else range(world.relations):
            h, r, t = answer
            competitor = ((candidate, r, t), (h, candidate, t), (h, r, candidate))[slot]
            if competitor == answer or splits.get(competitor) in FILTERED[filtering]:
                continue
            true += count(competitor) > count(answer)
            if count(competitor) != count(answer):
                predicted += won(score(*competitor), score(*answer))
        terms[filtering, truth, answer, slot] = 1 / (abs(true - predicted) + 1)
    return terms


def d1_of(world: World, model: int) -> list[Triple]:
    return sorted(world.of(model, TRAIN, VALID, TEST))


def value(world: World, model: int, terms: Terms, reading: Reading) -> float:
    """MRR* under a reading."""
    queried, observed = [], Counter[int]()
    for triple in d1_of(world, model):
        observed[triple[1]] += world.counts[triple]
        is_novel = bool({triple[0], triple[2]} & set(world.novel[model]))
        about = {"any": True, "known": not is_novel, "novel": is_novel, "both": True}[reading.about]
        if about and world.splits[model][triple] in SPLITS[reading.queries]:
            queried.append(triple)
    if not queried:
        return math.nan
    number, total = Counter(relation for _, relation, _ in queried), 0.0
    for slot, share in enumerate(SHARES[reading.slots]):
        weights = []
        for triple in queried:
            of_relation = 1.0 if slot == 1 else observed[triple[1]] / number[triple[1]]
            count = world.counts[triple]
            weights.append(
                {"triple": 1.0, "relation": of_relation, "observations": count}[reading.weights]
            )
        of_queries = [terms[reading.filter, reading.truth, triple, slot] for triple in queried]
        total += (
            share
            * sum(w * term for w, term in zip(weights, of_queries, strict=True))
            / sum(weights)
        )
    return total


@settings(max_examples=25)
@given(worlds())
def test_every_reading_is_the_mean_that_its_name_says(world: World) -> None:
    values = measured(world.embedding, world.session, torch.tensor(world.novel))
    for model in range(len(world.splits)):
        terms = terms_of(world, model)
        expected = [value(world, model, terms, reading) for reading in readings.readings()]
        assert values[model].tolist() == pytest.approx(expected, abs=1e-6, nan_ok=True)


# Epochs to convergence


def curves(models: int = len(SEEDS)) -> tuple[ReadingQueries, list[Embedding], Tensor]:
    """Queries, an embedding for each epoch from 0, and their MRR*; shape: (epochs, M, readings)."""
    embeddings = [random_embedding(models, 13, 3, 8, epoch) for epoch in range(LAST + 1)]
    queries = reading_queries(POINTS.session(1), POINTS.novel_in(1))
    return (
        queries,
        embeddings,
        torch.stack([of_points(POINTS, embedding) for embedding in embeddings]),
    )


def targets_of(values: Tensor) -> Tensor:
    """Random targets between the lowest and, now and then, above the highest MRR* of a run;
    shape: (M, readings).
    """
    low, high = values.amin(0), values.amax(0)
    share = torch.rand(low.shape, generator=torch.Generator().manual_seed(0), dtype=torch.float64)
    return low + (high - low) * 1.3 * share


def run_watch(watch: ReadingWatch, embeddings: list[Embedding]) -> list[int]:
    """Show a watch the embeddings that go on, as ``train`` does; the last epoch of each."""
    models, ended = torch.arange(len(SEEDS)), [LAST] * len(SEEDS)
    for epoch, embedding in enumerate(embeddings):
        going_on = watch(epoch, select(embedding, models), models)
        for model in models[~going_on].tolist():
            ended[model] = epoch
        models = models[going_on]
        if not len(models):
            break
    return ended


NAMES = [reading.name for reading in readings.readings()]
#: Of each reading, the places of those under which a run has to converge in one epoch: itself, or
#: known and novel.
PARTS = [
    [NAMES.index(name.replace("both", about)) for about in ("known", "novel")]
    if "both" in name
    else [place]
    for place, name in enumerate(NAMES)
]


def first_epochs(values: Tensor, target: Tensor, model: int) -> list[float]:
    """By reading, the first epoch at which a run is at its target; ∞: there is none;
    NaN: no queries.
    """
    epochs, by_epoch, goals = list[float](), values[:, model].tolist(), target[model].tolist()
    for parts in PARTS:
        asked = [part for part in parts if not math.isnan(goals[part])]
        reached = [all(numbers[part] >= goals[part] for part in asked) for numbers in by_epoch]
        epochs.append(math.nan if not asked else reached.index(True) if any(reached) else math.inf)
    return epochs


EVERY_SEED = torch.ones(len(SEEDS), dtype=torch.bool)


def test_a_run_ends_once_it_has_converged_under_every_reading() -> None:
    queries, embeddings, values = curves()
    target = targets_of(values)
    target[0] = values[2, 0]  # model 0 is there at epoch 2 under each
    watch = ReadingWatch(queries, target, EVERY_SEED, LAST, curves=False)
    ended = run_watch(watch, embeddings)
    assert ended[0] == 2
    for model, end in enumerate(ended):
        first = np.array(first_epochs(values, target, model)).clip(max=LAST)
        assert end == np.nanmax(first)
        np.testing.assert_array_equal(watch.epochs[model], first)
    assert watch.seen == []


def test_seeds_that_are_not_fine_tuned_end_at_once_without_effect_on_others() -> None:
    queries, embeddings, values = curves()
    target, some = targets_of(values), torch.tensor([True, False, True, True, False])
    every = ReadingWatch(queries, target, EVERY_SEED, LAST, curves=True)
    part = ReadingWatch(queries, target, some, LAST, curves=True)
    run_watch(every, embeddings)
    assert run_watch(part, embeddings) == [LAST, 0, LAST, LAST, 0]
    assert np.isnan(part.epochs[~some.numpy()]).all()
    np.testing.assert_array_equal(part.epochs[some.numpy()], every.epochs[some.numpy()])
    assert torch.equal(
        torch.stack(part.seen).nan_to_num(-1), torch.stack(every.seen)[:, some].nan_to_num(-1)
    )


def test_a_run_with_curves_goes_on_to_the_last_epoch_and_shows_every_one() -> None:
    queries, embeddings, values = curves()
    # all are reached at last
    watch = ReadingWatch(queries, values.amin(0), EVERY_SEED, LAST, curves=True)
    assert run_watch(watch, embeddings) == [LAST] * len(SEEDS)
    assert torch.equal(torch.stack(watch.seen).nan_to_num(-1), values.nan_to_num(-1))


def test_without_queries_about_novel_entities_a_run_converges_about_known_ones() -> None:
    queries, embeddings, values = curves()
    names = [f"test {about} triple alike learned all" for about in ("known", "novel", "both")]
    known, novel, both = places_of(names)
    target = torch.full_like(values[0], math.nan)
    target[:, known] = values[1:, :, known].amax(0)
    target[:, both] = math.inf  # not compared
    watch = ReadingWatch(queries, target, EVERY_SEED, LAST, curves=False)
    assert run_watch(watch, embeddings) == watch.epochs[:, known].tolist()
    assert np.isnan(watch.epochs[:, novel]).all()
    assert (watch.epochs[:, both] == watch.epochs[:, known]).all()


# The stage


@dataclass(frozen=True)
class Tables:
    """What the stage writes."""

    ranks: pd.DataFrame
    readings: pd.DataFrame
    answers: pd.DataFrame
    curves: dict[str, Tensor]


RunCase = Callable[..., Tables]


@pytest.fixture
def run_case(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> RunCase:
    """A function that runs the stage with some of a case's settings changed;
    returns what it writes.
    """
    stage_run.lay_out(tmp_path, stage_run.SMALL)
    monkeypatch.chdir(tmp_path)
    stage_run.run(f"mine {stage_run.NAME}")

    def run(stack: int = 2, workers: int = 1, **changed: Any) -> Tables:
        list_entries(readings={"own": READING_CASE | changed})
        params = yaml.safe_load(paths.PARAMS.read_text(encoding="utf-8"))
        params["compute"] |= {"stack": stack, "workers": workers}
        paths.PARAMS.write_text(yaml.safe_dump(params), encoding="utf-8")
        stage_run.run("measure_readings own")
        curves = READING_CURVES.read_file(READING_CURVES.path(case="own"))
        ranks, rows, answers = (table.read_text(case="own") for table in (RANKS, READINGS, ANSWERS))
        return Tables(ranks, rows, answers, curves)

    return run


def test_epochs_are_those_of_the_curves_and_curves_begin_right_after_insertion(
    run_case: RunCase,
) -> None:
    tables = run_case(finetuned_seeds=1)  # so a curve is that of seed 0
    table = tables.readings.assign(
        reading=tables.readings[list(readings.ASPECTS)].agg(" ".join, axis=1)
    )
    assert tables.curves.keys() == {f"{name}.size=03" for name in READING_CASE["initializers"]}

    def numbers(column: str, model: str, seed: int = 0) -> np.ndarray:
        """A column of a model's rows by reading."""
        rows = table[(table["model"] == model) & (table["k"] == 0) & (table["size"] == 3)]
        of_seed = rows[rows["seed"] == seed].set_index("reading")[column]
        return of_seed[NAMES].to_numpy(float)

    joint = numbers("mrr_star", "joint")
    assert np.isnan(numbers("epochs", "joint")).all()
    for name in READING_CASE["initializers"]:
        means, deviations = tables.curves[f"{name}.size=03"].double()
        assert means.shape == deviations.shape == (3, len(NAMES))  # epochs
        at_once = np.nan_to_num(numbers("mrr_star", name), nan=-1)
        np.testing.assert_allclose(means[0], at_once, atol=1e-6)
        assert set(deviations.unique().tolist()) <= {-1, 0}
        target = torch.from_numpy(joint - READING_CASE["changes"]["convergence.margin"])[None]
        by_epoch = means.where(means >= 0, math.nan)[:, None]
        expected = np.array(first_epochs(by_epoch, target, 0)).clip(max=2)
        np.testing.assert_array_equal(numbers("epochs", name), expected)
        assert np.isnan(numbers("epochs", name, seed=1)).all()


def test_curves_are_means_and_deviations_over_the_seeds_with_queries(run_case: RunCase) -> None:
    tables = run_case(indicators={}, initializers=["es"])
    rows = tables.readings[(tables.readings["model"] == "es") & (tables.readings["size"] == 3)]
    values = rows.pivot(index="seed", columns=[*readings.ASPECTS], values="mrr_star")
    ordered = values[[tuple(name.split()) for name in NAMES]]
    mean, deviation = tables.curves["es.size=03"][:, 0].double().numpy()
    np.testing.assert_allclose(mean, ordered.mean().fillna(-1), atol=1e-6)
    alone = ordered.notna().sum() == 1
    expected = ordered.std().mask(alone, 0).fillna(-1)
    np.testing.assert_allclose(deviation, expected, atol=1e-6)


def test_answers_rank_the_known_entities_for_each_novel_one_that_is_named(
    run_case: RunCase,
) -> None:
    named = ["apple", "bread", "mug", "plate", "sink", "pot", "lamp", "fork", "book", "bed"]
    answers = run_case(indicators={}, affordances=named).answers
    assert set(answers["entity"]) <= set(named)
    assert set(answers["model"]) == set(READING_CASE["initializers"])
    for _, rows in answers.groupby(["model", "seed", "entity"]):
        assert sorted(rows["rank"]) == list(range(1, len(rows) + 1))
        assert not set(rows["answer"]) & set(rows["entity"])  # which is novel
        assert "affordance" in set(rows["kind"])
    first = answers[answers["rank"] == 1]
    assert (first["kind"] == "affordance").any()


def test_a_size_that_is_not_fine_tuned_has_no_epochs(run_case: RunCase) -> None:
    tables = run_case(initializers=["xavier"], indicators={}, finetuned=[3], curves=[])
    assert tables.curves == {}
    decided = (
        tables.readings["epochs"]
        .notna()
        .groupby([tables.readings["model"], tables.readings["size"]])
        .any()
    )
    assert decided.to_dict() == {
        ("joint", 2): False,
        ("joint", 3): False,
        ("xavier", 2): False,
        ("xavier", 3): True,
    }


def test_what_is_measured_depends_neither_on_workers_nor_on_the_height_of_stacks(
    run_case: RunCase,
) -> None:
    fewer = {"initializers": ["xavier", "rs"], "indicators": {"rs": [2]}}
    first, *others = (run_case(*compute, **fewer) for compute in ((2, 1), (1, 2), (1, 1)))
    for other in others:
        pd.testing.assert_frame_equal(first.ranks, other.ranks, check_exact=True)
        pd.testing.assert_frame_equal(first.readings, other.readings, check_exact=True)
        assert first.curves.keys() == other.curves.keys()
        assert all(torch.equal(curves, other.curves[name]) for name, curves in first.curves.items())


def test_verify_computes_the_readings_again_and_names_altered_numbers(run_case: RunCase) -> None:
    tables = run_case(initializers=["xavier", "es"], finetuned=[], curves=[])

    def check() -> Check:
        compared = Check("readings of MRR*", 1e-5)
        check_readings("own", compared)
        return compared

    compared = check()
    # models (of ES with either k), sizes, seeds, readings by filter and truth; and ranks
    assert compared.number == 4 * 2 * 2 * len(NAMES) // 6 + len(tables.ranks)
    assert compared.disagreements == []
    assert compared.worst < 1e-7
    chosen = (
        tables.readings[["queries", "about", "weights"]] == ["held_out", "known", "relation"]
    ).all(axis=1)
    altered = tables.readings.assign(
        mrr_star=tables.readings["mrr_star"] - 1e-4 * (chosen & ~chosen.cumsum().gt(5))
    )
    READINGS.write(altered, "a_test", case="own")
    (line,) = check().disagreements
    assert line.startswith(
        "readings of MRR*, model es, k 0, size 2, seed 0, "
        "queries held_out, about known, weights relation, "
    )
    READINGS.write(tables.readings[1:], "a_test", case="own")
    assert len(check().disagreements) == 1
    READINGS.write(tables.readings, "a_test", case="own")
    RANKS.write(tables.ranks.assign(rank_true=tables.ranks["rank_true"] + 1), "a_test", case="own")
    disagreements = check().disagreements
    assert len(disagreements) == len(tables.ranks)
    assert all("terms of own" in line for line in disagreements)
    train = tables.ranks["split"] == "train"
    RANKS.write(
        tables.ranks.assign(closeness_none_all=tables.ranks["closeness_none_all"] ** (1 + train)),
        "a_test",
        case="own",
    )
    assert {line.split(", ")[5] for line in check().disagreements} == {
        "queries all",
        "queries train",
    }


def test_a_case_may_look_up_other_words(run_case: RunCase) -> None:
    phrases, definitions = (
        run_case(
            initializers=["es"],
            indicators={},
            changes=READING_CASE["changes"] | {"words.text": text},
        ).readings
        for text in ("phrase", "definition")
    )
    differs = phrases.set_index("model")["mrr_star"] != definitions.set_index("model")["mrr_star"]
    assert differs["es"].any()
    assert phrases[phrases["model"] == "joint"].equals(definitions[definitions["model"] == "joint"])


def test_a_case_with_more_novel_entities_than_there_are_is_refused_by_its_key(
    run_case: RunCase,
) -> None:
    with pytest.raises(
        SystemExit,
        match=r"^measure_readings: beyond/params\.yaml: readings\.own: .*sessions\.sizes: ",
    ):
        run_case(sessions=READING_CASE["sessions"] | {"sizes": [2, 3, 900]})
    assert not READINGS.path(case="own").parent.exists()
