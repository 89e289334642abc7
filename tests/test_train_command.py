"""``isi train``: the choice of a model, its measures beside simple ones, and the home that the
command writes or trains again.
"""

import shlex
import subprocess
import sys
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
from isi.cli import main
from isi.errors import InputError
from isi.evaluation.filtered import end_queries, random_ranks
from isi.experiment.train import TrainConfig, warn_of_batch
from isi.graph.graph import Graph, build_graph
from isi.graph.sessions import TEST, TRAIN, VALID
from isi.live.bundle import write
from isi.live.train import (
    OBSERVED,
    PER_TRIPLE,
    described,
    frequencies,
    groups_of,
    held_out,
    reciprocal_ranks,
    repeated_relations,
    tables_of,
    train_bundle,
    with_kinds,
)
from isi.models.bilinear import DistMult
from isi.training.batches import Negatives
from isi.training.trainer import Training
from tests.documented import DOCS
from tests.plain_ranks import plain_rank
from tests.small_graphs import points_of, random_graph

EXAMPLES = DOCS.parent / "examples"
BLOCKED = (
    "numba",
    "gensim",
    "pyarrow",
    "dvc",
    "rdflib",
    "pykeen",
    "procthor",
    "ai2thor",
    "matplotlib",
)


def home() -> pd.DataFrame:
    return pd.read_csv(EXAMPLES / "home.csv")


def named(heads: int, seed: int, random: bool) -> list[tuple[str, str, str]]:
    """Triples of two kinds of things, which have each place and use of their kind;
    or as many at random.
    """
    rng, triples = np.random.default_rng(seed), list[tuple[str, str, str]]()
    for head in range(heads):
        for relation in ("in", "for"):
            tails = [2 * number + head % 2 for number in range(4)]
            if random:
                tails = rng.choice(8, 4, replace=False).tolist()
            triples += [(f"thing {head}", relation, f"{relation} {tail}") for tail in tails]
    return triples


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
    splits, repeating = held_out(graph, groups_of(graph, repeated), 0, 3), set(chain(*repeated))
    assert (splits == splits[0])[:, splits[0] == TEST].all()
    assert len({tuple(row) for row in splits.tolist()}) == 3
    for row in splits:
        assert {TRAIN, TEST, VALID} == set(row.tolist())
        split_of = dict[frozenset[int], int]()
        for (head, relation, tail), split in zip(graph.triples.tolist(), row.tolist(), strict=True):
            if relation in repeating:
                assert split_of.setdefault(frozenset([head, tail]), split) == split
        left = graph.triples[torch.from_numpy(row) == TRAIN]
        assert len(left[:, [0, 2]].unique()) == len(graph.entities)
        assert len(left[:, 1].unique()) == len(graph.relations)


def test_repeated_random_triples_teach_nothing() -> None:
    _, summary = train_bundle(tables_of(inverse(random_pairs(0))), dimension=16, budget=3)
    assert summary.mrr is not None
    assert summary.chance is not None
    assert summary.mrr < 2 * summary.chance
    assert "learned nothing" in str(summary.warning)
    assert summary.repeated == [["of r0", "r0"]]
    assert "of r0" in str(summary)


def test_a_home_is_learned_and_equal_arguments_give_equal_bytes(tmp_path: Path) -> None:
    tables = tables_of(home())
    for name in "ab":
        bundle, summary = train_bundle(
            tables, model="analogy", learning_rate=0.1, dimension=32, budget=1
        )
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
    assert summary.batch_size == 48
    assert summary.warning is None
    other, _ = train_bundle(
        tables, model="analogy", learning_rate=0.1, dimension=32, budget=1, seed=1
    )
    assert not np.array_equal(other.entities, bundle.entities)


def test_what_can_be_learned_is_and_what_is_random_warns() -> None:
    for random in (False, True):
        _, summary = train_bundle(tables_of(named(24, 0, random)), dimension=16, budget=2)
        assert summary.mrr is not None
        assert summary.frequency is not None
        assert (summary.warning is not None) == random
        assert (summary.mrr > 1.5 * summary.frequency) != random


def test_a_graph_without_spare_triples_is_trained_and_says_that_nothing_is_measured() -> None:
    bundle, summary = train_bundle(
        tables_of([("cup", "in", "kitchen"), ("bed", "in", "bedroom")]), dimension=8
    )
    assert bundle.entities.shape == (4, 8)
    assert summary.test_triples == 0
    assert summary.mrr is None
    assert summary.warning


def test_forms_of_triples_give_the_same_graph() -> None:
    rows = [("cup", "in", "kitchen"), ("bed", "in", "bedroom"), ("cup", "in", "kitchen")]
    frame = pd.DataFrame(
        {"tail": ["kitchen", "bedroom"], "count": [2, 1], "head": ["cup", "bed"], "relation": "in"}
    )
    mapping = {"cup": {"in": "kitchen"}, "bed": {"in": ["bedroom"]}}
    listed = tables_of(rows)
    for form in (np.array(rows), frame):
        pd.testing.assert_frame_equal(tables_of(form).triples, listed.triples)
    assert tables_of(mapping).triples["count"].tolist() == [1, 1]


@pytest.mark.parametrize(
    "wrong",
    [
        {"model": "analgy"},
        {"dimension": 30, "model": "analogy"},
        {"budget": 0},
        {"learning_rate": -1.0},
    ],
)
def test_wrong_options_are_named(wrong: dict[str, float | str]) -> None:
    with pytest.raises(InputError, match=next(iter({"model"} & wrong.keys() or wrong))):
        train_bundle(tables_of([("cup", "in", "kitchen")]), **wrong)  # type: ignore[arg-type]


def test_divergence_names_the_learning_rate() -> None:
    with pytest.raises(InputError, match="learning rate"):
        train_bundle(tables_of(home()), model="analogy", learning_rate=1e14, dimension=16, budget=1)


def test_the_command_writes_a_home_that_is_trained_again_on_what_it_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    files = [str(EXAMPLES / "home.csv"), "--kinds", str(EXAMPLES / "home_kinds.csv")]
    options = ["--budget", "1", "--dimension", "8"]
    main(["train", *files, "--out", "home", *options])
    shown = capsys.readouterr().out
    assert "85 entities" in shown
    with isi.open("home") as home:
        assert not home.groups.preparation()
        assert f"{home.base.manifest.made['mrr']:.3f}" in shown
        assert home.base.kinds[home.base.entity_names.index("apple")] == "object"
        home.tell([("espresso machine", "atLocation", "kitchen")])
        home.remove(facts=[("apple", "atLocation", "kitchen")])
    main(["train", "home", *options])
    assert "86 entities" in capsys.readouterr().out
    with isi.open("home") as home:
        assert (list(home.inserted), home.groups.preparation()) == ([], [])
        assert home.base.kinds[home.base.entity_names.index("espresso machine")] == "object"
        assert ("apple", "atLocation", "kitchen") not in home.base.named_triples()
        assert [change.verb for change in home.history] == ["tell", "remove", "train"]
        with pytest.raises(InputError, match="undo"):
            home.undo()


def test_printed_commands_can_be_pasted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    names = 'the "$(touch made)" cup', "is in", "mother's kitchen"
    frame = pd.DataFrame(
        [names, (names[0], "near", names[2])], columns=["head", "relation", "tail"]
    )
    frame.to_csv("home.csv", index=False)
    kinds = pd.DataFrame({"entity": ["mother's kitchen", "mug"], "kind": ["room", "object"]})
    kinds.to_csv("kinds.csv", index=False)
    out = "new home/it's $HOME"
    command = ["train", "home.csv", "--kinds", "kinds.csv", "--out", out, "--dimension", "8"]
    main([*command, "--budget", "0.1"])
    shown = capsys.readouterr().out
    assert "Warning: kinds.csv: 1 of 2 names match no entity ('mug')" in shown
    ask, tell = (shlex.split(line) for line in shown.splitlines() if line.startswith("  isi "))
    assert ask == ["isi", "ask", *names[:2], "--home", out]
    assert tell == ["isi", "tell", "NEW NAME", *names[1:], "--home", out]
    main(ask[1:])
    main(tell[1:])


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


def test_kinds_are_of_exact_names_and_the_rest_is_named() -> None:
    named, note = with_kinds(tables_of(HOMES), {"mug": "toy", "Cup": "object", "Mugg": "object"})
    kinds = dict(zip(named.entities["entity"], named.entities["kind"], strict=True))
    assert [name for name, kind in kinds.items() if kind != "entity"] == ["mug"]
    assert "2 of 3 names match no entity ('Cup', 'Mugg'" in note
    assert "4 of 5 entities have no kind" in note


@pytest.mark.parametrize("as_file", [False, True])
def test_kinds_given_in_python_count_for_triples_and_for_a_file(
    tmp_path: Path, as_file: bool
) -> None:
    path = tmp_path / "home.csv"
    pd.DataFrame(HOMES, columns=["head", "relation", "tail"]).to_csv(path, index=False)
    options: dict[str, Any] = {"dimension": 8, "budget": 0.1}
    with pytest.warns(
        UserWarning,
        match="kinds: 1 of 2 names match no entity.*'cupp'.*4 of 5 entities have no kind",
    ):
        home = isi.train(
            path if as_file else HOMES, kinds={"kitchen": "room", "cupp": "object"}, **options
        )
    assert home.base.kinds[home.base.entity_names.index("kitchen")] == "room"
    with pytest.raises(InputError, match="argument 'kinds'"):
        isi.train(HOMES, kinds={"cup": "ob\tject"}, **options)


@pytest.mark.parametrize(("entities", "triples"), [(40, 80), (9000, 4000)])
def test_a_count_of_millions_costs_no_more_than_small_ones(entities: int, triples: int) -> None:
    """On a small graph and on one with lists of triples."""
    ends = np.random.default_rng(0).integers(entities, size=(triples, 2)).tolist()
    rows = [(f"e{head}", "near", f"e{tail}", 1) for head, tail in ends]
    rows[0] = (*rows[0][:3], 200_000_000)
    frame = pd.DataFrame(rows, columns=["head", "relation", "tail", "count"])
    frame = frame.drop_duplicates(["head", "tail"])
    with pytest.warns(UserWarning, match="scaled down"):
        made = isi.train(frame, model="distmult", dimension=4, budget=0.1).base.manifest.made
    assert made["observations"] == 200_000_000 + len(frame) - 1
    assert made["epoch_observations"] < max(OBSERVED, PER_TRIPLE * len(frame)) + len(frame)


@pytest.mark.parametrize("name", [["cup"], {"cup": 1}, {"cup"}, None, 1, b"cup"])
def test_names_that_are_no_text_are_refused(name: Any) -> None:
    with pytest.raises(InputError, match="argument 'triples': triple 1: tail: expected a name"):
        tables_of([("cup", "in", "kitchen"), ("bed", "in", name)])


def test_what_a_reader_counts_is_a_warning_in_python(tmp_path: Path) -> None:
    path = tmp_path / "home.csv"
    pd.DataFrame(HOMES).to_csv(path, index=False, header=["Thing", "Link", "Other thing"])
    with (
        pytest.warns(UserWarning, match=f"without a header.*: {len(HOMES) + 1}"),
        pytest.warns(UserWarning, match="first line.*'Thing Link Other thing'"),
    ):
        isi.train(path, dimension=8, budget=0.1)


def test_core_packages_suffice(tmp_path: Path) -> None:
    program = (
        f"import sys; sys.modules.update(dict.fromkeys({BLOCKED!r})); from isi.cli import main; "
        "main(sys.argv[1:])"
    )
    command = ["train", str(EXAMPLES / "home.csv"), "--out", "home", "--model", "complex"]
    done = subprocess.run(
        [sys.executable, "-c", program, *command, "--budget", "1"],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "home" / "home.sqlite").exists()


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
        TrainConfig(
            0, DistMult(), 8, 0.01, Negatives(mode="expected", ratio=1, head_pool="all"), training
        ),
    )
    assert ("batch_size" in capsys.readouterr().err) == (size > 1)


@pytest.mark.parametrize(
    ("triples", "place"),
    [
        ([("cup", "in")], "triple 0"),
        ([("cup", "in", "kitchen"), ("cup", "in", "")], "triple 1"),
        ([("cup", "in", 5)], "triple 0"),
        ([], ""),
        (
            pd.DataFrame({"head": ["cup"], "relation": ["in"], "tail": ["kitchen"], "count": [0]}),
            "count",
        ),
    ],
)
def test_wrong_triples_are_named(triples: object, place: str) -> None:
    with pytest.raises(InputError) as error:
        tables_of(triples)  # type: ignore[arg-type]
    assert "triples" in error.value.file
    assert place in error.value.place
