"""``isi train``: the choice of a model, its measures beside simple ones, and the home that the
command writes or trains again.
"""

from collections import Counter
from collections.abc import Callable
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
import torch

import isi
from isi.errors import InputError
from isi.evaluation.filtered import end_queries, random_ranks
from isi.formats.plain import write
from isi.graph.graph import Graph, build_graph
from isi.graph.sessions import TEST, TRAIN, VALID
from isi.home.train import described, tables_of, train_bundle
from isi.models.bilinear import DistMult
from isi.training.batches import Negatives
from isi.training.fit import TrainConfig
from isi.training.held_out import (
    frequencies,
    groups_of,
    held_out,
    reciprocal_ranks,
    repeated_relations,
)
from isi.training.trainer import Training
from stages.train_theta0 import warn_of_batch
from tests.documented import DOCS
from tests.plain_ranks import plain_rank
from tests.small_graphs import points_of, random_graph

EXAMPLES = DOCS.parent / "examples"


def home() -> pd.DataFrame:
    return pd.read_csv(EXAMPLES / "home.csv")


def test_measures_agree_with_brute_force() -> None:
    graph, trained = random_graph(12, 3, 60), torch.arange(60) % 4 != 0
    known, ids = set(map(tuple, graph.triples.tolist())), (~trained).nonzero()[:, 0]
    queries, rng = end_queries(graph, ids[None]), np.random.default_rng(0)
    numbers: Counter[tuple[int, int, int]] = Counter()
    for head, relation, tail in graph.triples[trained].tolist():
        numbers.update([(0, relation, head), (2, relation, tail)])
    by_frequency, at_random = [], []
    for slot in (0, 2):
        for triple in graph.triples[ids].tolist():
            others = [[*triple[:slot], entity, *triple[slot + 1 :]] for entity in range(12)]
            wrong = [other for other in others if tuple(other) not in known]
            own = numbers[slot, triple[1], triple[slot]]
            counts = [numbers[slot, triple[1], other[slot]] for other in wrong]
            by_frequency.append(1 / plain_rank(counts, own))
            at_random.append(np.mean(1 / (1 + rng.integers(0, len(wrong) + 1, 20_000))))
    ranks = reciprocal_ranks(queries, frequencies(graph, trained, queries))
    assert ranks.tolist() == pytest.approx(by_frequency)
    assert random_ranks(~queries.right, queries).tolist() == pytest.approx(at_random, abs=0.02)


Named = list[tuple[str, str, str]]


def random_pairs(seed: int) -> Named:
    """150 random triples of each of two relations between 40 entities."""
    rng = np.random.default_rng(seed)
    ids = [rng.choice(40 * 40, 150, replace=False) for _ in range(2)]
    return [
        (f"e{pair // 40}", "r0" if first else "r1", f"e{pair % 40}")
        for first, part in zip((True, False), ids, strict=True)
        for pair in part.tolist()
    ]


def inverse(triples: Named) -> Named:
    """With an inverse of the first relation, which lacks a tenth of the triples."""
    return [*triples, *((tail, "of r0", head) for head, relation, tail in triples[:135])]


def symmetric(triples: Named) -> Named:
    return [*triples, *((tail, relation, head) for head, relation, tail in triples[:150])]


def equal(triples: Named) -> Named:
    return [*triples, *((head, "as r0", tail) for head, relation, tail in triples[:150])]


def graph_of_named(triples: Named) -> Graph:
    tables = tables_of(triples)
    return build_graph(tables.entities, tables.triples)


REPEATING = [
    (inverse, [["of r0", "r0"]]),
    (symmetric, [["r0"]]),
    (equal, [["as r0", "r0"]]),
    (list, []),
]


@pytest.mark.parametrize(("more", "expected"), REPEATING)
def test_triples_that_repeat_each_other_have_one_split(
    more: Callable[[Named], Named], expected: list[list[str]]
) -> None:
    graph = graph_of_named(more(random_pairs(0)))
    repeated = repeated_relations(graph)
    assert [[graph.relations[row] for row in rows] for rows in repeated] == expected
    splits, repeating = held_out(graph, groups_of(graph, repeated), 0), set(chain(*repeated))
    assert {TRAIN, TEST, VALID} == set(splits.tolist())
    split_of = dict[frozenset[int], int]()
    for (head, relation, tail), split in zip(graph.triples.tolist(), splits.tolist(), strict=True):
        if relation in repeating:
            assert split_of.setdefault(frozenset([head, tail]), split) == split
    left = graph.triples[torch.from_numpy(splits) == TRAIN]
    assert len(left[:, [0, 2]].unique()) == len(graph.entities)
    assert len(left[:, 1].unique()) == len(graph.relations)


def test_repeated_random_triples_teach_nothing() -> None:
    _, summary = train_bundle(tables_of(inverse(random_pairs(0))), dimension=16)
    assert summary.mrr is not None
    assert summary.chance is not None
    assert summary.mrr < 2 * summary.chance
    assert "learned nothing" in str(summary.warning)
    assert summary.repeated == [["of r0", "r0"]]
    assert "of r0" in str(summary)


def test_a_home_is_learned_and_equal_arguments_give_equal_bytes(tmp_path: Path) -> None:
    tables = tables_of(home())
    for name in "ab":
        bundle, summary = train_bundle(tables, learning_rate=0.1, dimension=32)
        (tmp_path / name).mkdir()
        write(tmp_path / name, bundle)
    assert {path.name: path.read_bytes() for path in (tmp_path / "a").iterdir()} == {
        path.name: path.read_bytes() for path in (tmp_path / "b").iterdir()
    }
    assert (summary.entities, summary.relations, summary.triples, summary.observations) == (
        85,
        3,
        401,
        480,
    )
    assert summary.mrr is not None and summary.frequency is not None and summary.chance is not None  # noqa: PT018
    assert summary.mrr > summary.frequency + 0.1 > summary.frequency > summary.chance
    assert summary.warning is None
    other, _ = train_bundle(tables, learning_rate=0.1, dimension=32, seed=1)
    assert not np.array_equal(other.entities, bundle.entities)


def test_a_graph_without_spare_triples_is_trained_and_says_that_nothing_is_measured() -> None:
    bundle, summary = train_bundle(
        tables_of([("cup", "in", "kitchen"), ("bed", "in", "bedroom")]), dimension=8
    )
    assert bundle.entities.shape == (4, 8)
    assert summary.test_triples == 0
    assert summary.mrr is None
    assert summary.warning


def test_divergence_names_the_learning_rate() -> None:
    with pytest.raises(InputError, match="learning rate"):
        train_bundle(tables_of(home()), learning_rate=1e14, dimension=16)


def test_a_table_of_entities_gives_kinds_and_phrases(tmp_path: Path) -> None:
    tables, path = tables_of([("cup", "in", "kitchen")]), tmp_path / "entities.csv"
    path.write_text(
        "entity,kind,phrase\ncup,object,\nkitchen,,the kitchen\nsofa,object,\n", "utf-8"
    )
    named, note = described(tables, path)
    assert named.entities[["kind", "phrase"]].values.tolist() == [
        ["object", "cup"],
        ["entity", "the kitchen"],
    ]
    assert "1 of 3 names match no entity ('sofa')" in note
    assert "1 of 2 entities have no kind ('kitchen')" in note
    path.write_text("entity,kind\nsofa,object\n", "utf-8")
    with pytest.raises(InputError, match=r"entities\.csv.*'sofa'"):
        described(tables, path)


HOMES = [("cup", "in", "kitchen"), ("Mug", "in", "kitchen"), ("mug", "in", "bedroom")]


@pytest.mark.parametrize("as_file", [False, True])
def test_kinds_are_of_exact_names_for_triples_and_for_a_file_and_the_rest_is_named(
    tmp_path: Path, as_file: bool
) -> None:
    path = tmp_path / "home.csv"
    pd.DataFrame(HOMES, columns=["head", "relation", "tail"]).to_csv(path, index=False)
    options: dict[str, Any] = {"dimension": 8}
    kinds = {"mug": "toy", "Cup": "object", "Mugg": "object"}
    note = "kinds: 2 of 3 names match no entity.*'Cup', 'Mugg'.*4 of 5 entities have no kind"
    with pytest.warns(UserWarning, match=note):
        home = isi.train(path if as_file else HOMES, kinds=kinds, **options)
    assert dict(zip(home.base.entity_names, home.base.kinds, strict=True))["mug"] == "toy"
    assert home.base.kinds.count("") == 4
    with pytest.raises(InputError, match="argument 'kinds'"):
        isi.train(HOMES, kinds={"cup": "ob\tject"}, **options)


def test_a_count_of_millions_trains_as_one_does() -> None:
    frame = home()
    often = frame.assign(count=[200_000_000] + [1] * (len(frame) - 1))
    trained = [isi.train(each, dimension=4).base for each in (frame, often)]
    assert np.array_equal(trained[0].entities, trained[1].entities)
    assert trained[1].manifest.made["observations"] > 200_000_000


def test_what_a_reader_counts_is_a_warning_in_python(tmp_path: Path) -> None:
    path = tmp_path / "home.csv"
    pd.DataFrame(HOMES).to_csv(path, index=False, header=["Thing", "Link", "Other thing"])
    told = f"without a header.*'Thing Link Other thing': {len(HOMES) + 1}"
    with pytest.warns(UserWarning, match=told):
        isi.train(path, dimension=8)


@pytest.mark.parametrize("size", [1, 10_000])
def test_a_batch_of_all_observations_warns(size: int, capsys: pytest.CaptureFixture[str]) -> None:
    points = points_of(random_graph(12, 3, 60), 2, [5, 6])
    training = Training(
        batch_size=size,
        learning_rate=0.1,
        weight_decay=0.0,
        max_epochs=1,
        evaluate_every=1,
        patience=1,
    )
    warn_of_batch(
        points,
        TrainConfig(0, DistMult(), 8, 0.01, Negatives(mode="expected", ratio=1), training),
    )
    assert ("batch_size" in capsys.readouterr().err) == (size > 1)


CUP = ("cup", "in", "kitchen")
NO_COUNT = pd.DataFrame([(*CUP, 0)], columns=["head", "relation", "tail", "count"])
NO_NAMES: list[Any] = [["cup"], {"cup": 1}, {"cup"}, None, 1.5, b"cup", ""]


@pytest.mark.parametrize(
    ("triples", "place"),
    [
        ([("cup", "in")], "triple 0"),
        ([], ""),
        (NO_COUNT, "count"),
        *(([CUP, ("bed", "in", name)], "triple 1") for name in NO_NAMES),
    ],
)
def test_wrong_triples_are_named(triples: Any, place: str) -> None:
    with pytest.raises(InputError) as error:
        tables_of(triples)
    assert "triples" in error.value.file
    assert place in error.value.place
