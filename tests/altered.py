"""Alterations of the tables and tensors of a small run, who reads each, and the rule that it breaks."""

# ruff: noqa: E501

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pandas as pd
import torch

from isi.tables import catalogue, io, paths
from isi.tables.catalogue import Schema
from tests.lawful import Alter
from tests.small import NAME

Tensors = dict[str, torch.Tensor]


def put(column: str, value: object, row: int = 0) -> Alter:
    """Another value in a row."""

    def altered(frame: pd.DataFrame) -> pd.DataFrame:
        plain = io.as_text(frame)
        plain[column] = [value if number == row else old for number, old in enumerate(plain[column])]
        return plain

    return altered


def at_end(column: str) -> Alter:
    """An id that is above all, in the last row."""
    return lambda frame: put(column, 10**6, len(frame) - 1)(frame)


def doubled(frame: pd.DataFrame) -> pd.DataFrame:
    return pd.concat([frame[:1], frame])


def swapped(frame: pd.DataFrame) -> pd.DataFrame:
    return frame.iloc[[1, 0, *range(2, len(frame))]]


def shuffled(frame: pd.DataFrame) -> pd.DataFrame:
    return frame.sample(frac=1, random_state=0)


def less(rows: int) -> Alter:
    return lambda frame: frame[rows:]


def as_test_and_train(frame: pd.DataFrame) -> pd.DataFrame:
    again = io.as_text(frame[:1]).assign(split=lambda row: "test" if row["split"].iloc[0] == "train" else "train")
    return pd.concat([again, io.as_text(frame)])


def a_known_end_less(frame: pd.DataFrame) -> pd.DataFrame:
    """Of one seed, what trains one entity becomes validation."""
    triples = io.read_text(paths.triples(NAME), catalogue.TRIPLES)
    plain = io.as_text(frame)
    own = (triples["head"] == triples["head"][0]) | (triples["tail"] == triples["head"][0])
    plain.loc[(plain["seed"] == 0) & plain["triple"].isin(own[own].index), "split"] = "valid"
    return plain


def of_a_test_triple(frame: pd.DataFrame) -> pd.DataFrame:
    """A triple told that is of its entity, but of the test split."""
    splits = io.read_text(paths.splits(NAME), catalogue.SPLITS)
    plain, ids = frame.copy(), dict(zip(entities()["entity"], range(len(entities())), strict=True))
    triples = io.read_text(paths.triples(NAME), catalogue.TRIPLES)
    ends = triples[["head", "tail"]].replace(ids).astype(int)
    novel = io.read(paths.novel(NAME), catalogue.NOVEL)
    for row in range(len(plain)):
        size, seed, entity = plain.loc[row, ["size", "seed", "entity"]]
        hidden = splits.loc[(splits["seed"] == seed) & (splits["split"] == "test"), "triple"]
        others = set(novel.loc[(novel["size"] == size) & (novel["seed"] == seed), "entity"]) - {entity}
        own = [one for one in hidden if (ends.loc[one] == entity).sum() == 1 and not set(ends.loc[one]) & others]
        if own:
            plain.loc[row, "triple"] = own[0]
            return plain.sort_values(["size", "seed", "session", "entity", "triple"])
    raise AssertionError("no novel entity has a test triple")


def of_another(frame: pd.DataFrame) -> pd.DataFrame:
    """A triple told that is not of its entity."""
    triples = io.read_text(paths.triples(NAME), catalogue.TRIPLES)
    name = entities()["entity"][int(frame["entity"][0])]
    other = triples.index[(triples["head"] != name) & (triples["tail"] != name)][0]
    return frame.assign(triple=[other, *frame["triple"][1:]]).sort_values(
        ["size", "seed", "session", "entity", "triple"]
    )


def another_novel(frame: pd.DataFrame) -> pd.DataFrame:
    """Another entity in the first set, which has one."""
    return frame.assign(entity=[(int(frame["entity"][0]) + 1) % len(entities()), *frame["entity"][1:]])


def entities() -> pd.DataFrame:
    return io.read_text(paths.entities(NAME), catalogue.ENTITIES)


def twice_in_a_set(frame: pd.DataFrame) -> pd.DataFrame:
    row = int(frame.index[frame["size"] == 2][0])
    return put("entity", int(frame["entity"][row]), row + 1)(frame)


OBSERVED, KINDS, ENTITIES = paths.observations(NAME), paths.kinds(NAME), paths.entities(NAME)
TRIPLES, SPLITS, NOVEL, TOLD = paths.triples(NAME), paths.splits(NAME), paths.novel(NAME), paths.insert_triples(NAME)
JOINT_RUNS, THETA0, WORDS = paths.runs(NAME, "joint"), paths.theta0(NAME, 2), paths.vectors(NAME)
#: What was altered, the table, how, who reads it, and the rule that is broken; null: only its digest tells.
CASES: list[tuple[str, Path, Schema, Alter, str, str | None]] = [
    ("a count of 0", OBSERVED, catalogue.OBSERVATIONS, put("count", 0), "build_graph", "row 0 .count 0.: .*from 1 on"),
    ("a count of -5", OBSERVED, catalogue.OBSERVATIONS, put("count", -5, 3), "build_graph", "row 3 .count -5.: .*from 1"),
    ("a count of 2e9", OBSERVED, catalogue.OBSERVATIONS, put("count", 2 * 10**9), "build_graph", "1,000,000,000 observat"),
    ("a blank head", OBSERVED, catalogue.OBSERVATIONS, put("head", " "), "build_graph", "'head' to be a name"),
    ("a tail of 10 kB", OBSERVED, catalogue.OBSERVATIONS, put("tail", "x" * 10**4), "build_graph", "'tail' to be a name"),
    ("no relation", OBSERVED, catalogue.OBSERVATIONS, put("relation", None), "build_graph", "a value in column"),
    ("an observation less", OBSERVED, catalogue.OBSERVATIONS, less(1), "build_graph", None),
    ("a kind twice", KINDS, catalogue.KINDS, doubled, "build_graph", "no second row of the same entity"),
    ("no kind", KINDS, catalogue.KINDS, put("kind", None), "build_graph", "a value in column 'kind'"),
    ("a kind less", KINDS, catalogue.KINDS, less(1), "build_graph", "expected the kind of"),
    ("another kind", KINDS, catalogue.KINDS, put("kind", "robot"), "build_graph", None),
    ("an entity doubled", ENTITIES, catalogue.ENTITIES, doubled, "make_sessions", "no second row of the same entity"),
    ("entities swapped", ENTITIES, catalogue.ENTITIES, swapped, "make_sessions", "row 1 .*ascending order of entity"),
    ("an entity less", ENTITIES, catalogue.ENTITIES, less(1), "make_sessions", "a name in entities.parquet"),
    ("an entity renamed", ENTITIES, catalogue.ENTITIES, put("entity", "aaa"), "make_sessions", "a name in entities.parq"),
    ("a control character", ENTITIES, catalogue.ENTITIES, put("entity", "a\tb"), "make_sessions", "no control character"),
    ("a triple doubled", TRIPLES, catalogue.TRIPLES, doubled, "make_sessions", "no second row of the same head, relation"),
    ("triples swapped", TRIPLES, catalogue.TRIPLES, swapped, "make_sessions", "row 1 .*ascending order of head"),
    ("an unknown tail", TRIPLES, catalogue.TRIPLES, put("tail", "0", 0), "make_sessions", "a name in entities.parquet"),
    ("an unknown relation", TRIPLES, catalogue.TRIPLES, put("relation", "aaa"), "make_sessions", None),
    ("a triple's count of 0", TRIPLES, catalogue.TRIPLES, put("count", 0, 2), "make_sessions", "row 2 .count 0."),
    ("a triple's count of -5", TRIPLES, catalogue.TRIPLES, put("count", -5), "make_sessions", "'count' from 1 on"),
    ("a triple's count of 2e9", TRIPLES, catalogue.TRIPLES, put("count", 2 * 10**9), "make_sessions", "1,000,000,000"),
    ("another count", TRIPLES, catalogue.TRIPLES, put("count", 1234), "make_sessions", None),
    ("both train and test", SPLITS, catalogue.SPLITS, as_test_and_train, "train_theta0", "row 1 .*each once"),
    ("100 triples without a split", SPLITS, catalogue.SPLITS, less(100), "train_theta0", "seed 0, triple 0: has no split"),
    ("triple -1", SPLITS, catalogue.SPLITS, put("triple", -1), "train_theta0", "row 0 .triple -1.: .*from 0 on"),
    ("a triple above all", SPLITS, catalogue.SPLITS, at_end("triple"), "train_theta0", "expected ids below"),
    ("an unknown split", SPLITS, catalogue.SPLITS, put("split", "dev"), "train_theta0", "among train, valid, test"),
    ("all test", SPLITS, catalogue.SPLITS, lambda f: f.assign(split="test"), "train_theta0", "seed 0: .*triples in train"),
    ("all train", SPLITS, catalogue.SPLITS, lambda f: f.assign(split="train"), "train_joint", "triples in valid"),
    ("an entity untrained", SPLITS, catalogue.SPLITS, a_known_end_less, "train_theta0", "in train, as of every entity"),
    ("splits shuffled", SPLITS, catalogue.SPLITS, shuffled, "train_theta0", "ascending order of seed, triple"),
    ("seed -1", SPLITS, catalogue.SPLITS, put("seed", -1), "train_theta0", "'seed' from 0 on"),
    ("seeds of splits changed", SPLITS, catalogue.SPLITS, lambda f: f.assign(seed=f["seed"] + 1), "train_theta0",
     "novel.*expected seeds that have splits"),
    ("entity -1", NOVEL, catalogue.NOVEL, put("entity", -1), "train_theta0", "row 0 .entity -1.: .*from 0 on"),
    ("an entity above all", NOVEL, catalogue.NOVEL, put("entity", 10**6), "train_theta0", "row 0 .*expected ids below"),
    ("twice in a set", NOVEL, catalogue.NOVEL, twice_in_a_set, "train_theta0", "ascending order of size, seed, session"),
    ("novel shuffled", NOVEL, catalogue.NOVEL, shuffled, "train_theta0", "ascending order of size, seed, session, entity"),
    ("a novel entity less", NOVEL, catalogue.NOVEL, lambda f: f[:-1], "train_theta0", "as many rows of each size"),
    ("nobody novel", NOVEL, catalogue.NOVEL, lambda f: f[:0], "train_theta0", "at least one set of novel entities"),
    ("a seed less", NOVEL, catalogue.NOVEL, less(1), "train_theta0", "the same seeds, and the same sessions"),
    ("session 0", NOVEL, catalogue.NOVEL, lambda f: f.assign(session=0), "train_joint", "'session' from 1 on"),
    ("session 2 alone", NOVEL, catalogue.NOVEL, lambda f: f.assign(session=2), "train_joint", "the same sessions from 1"),
    ("another novel entity", NOVEL, catalogue.NOVEL, another_novel, "train_theta0", None),
    ("a test triple told", TOLD, catalogue.INSERT_TRIPLES, of_a_test_triple, "insert", "of the seed's train split"),
    ("a triple of others told", TOLD, catalogue.INSERT_TRIPLES, of_another, "insert", "the entity at one end"),
    ("told of a known entity", NOVEL, catalogue.NOVEL, another_novel, "insert",
     "insert_triples.* an entity that the session inserts|from another"),
    ("told triple -1", TOLD, catalogue.INSERT_TRIPLES, put("triple", -1), "insert", "'triple' from 0 on"),
    ("told triple above all", TOLD, catalogue.INSERT_TRIPLES, at_end("triple"), "insert", "expected ids below"),
    ("told twice", TOLD, catalogue.INSERT_TRIPLES, doubled, "insert", "ascending order of .*, each once"),
    ("told less", TOLD, catalogue.INSERT_TRIPLES, less(1), "insert", None),
    ("MRR* of 1.5", JOINT_RUNS, catalogue.RUNS, put("mrr_star", 1.5), "insert", "row 0 .*'mrr_star' from 0 to 1"),
    ("MRR* not the mean", JOINT_RUNS, catalogue.RUNS, put("mrr_star", 0.0), "insert", "'mrr_star' to be the mean of"),
    ("MRR* null", JOINT_RUNS, catalogue.RUNS, put("mrr_star", None), "insert", "null where 'queries' is 0"),
    ("an unknown scope", JOINT_RUNS, catalogue.RUNS, put("scope", "some"), "insert", "'scope' among all, known"),
    ("epoch -1", JOINT_RUNS, catalogue.RUNS, put("epoch", -1), "insert", "'epoch' from 0 on"),
    ("no model of a seed", JOINT_RUNS, catalogue.RUNS, lambda f: f[f["seed"] > 0], "insert", "a row of each of seeds"),
]  # fmt: skip


def relabelled(tensors: Tensors) -> None:
    tensors["seed"] += 1


def seeds_swapped(tensors: Tensors) -> None:
    tensors["seed"] = tensors["seed"].flip(0)


def rows_shuffled(tensors: Tensors) -> None:
    tensors["entity"] = tensors["entity"].roll(1, 1)


def novel_known(tensors: Tensors) -> None:
    tensors["known"][:] = True


def novel_with_a_vector(tensors: Tensors) -> None:
    tensors["entity"][~tensors["known"]] = 0.5


def infinite(tensors: Tensors) -> None:
    next(iter(tensors.values())).view(-1)[3] = torch.inf


def not_a_number(tensors: Tensors) -> None:
    tensors["entity"][0, 1, 2] = torch.nan


def cut(name: str, dimension: int) -> Callable[[Tensors], None]:
    def altered(tensors: Tensors) -> None:
        tensors[name] = tensors[name].narrow(dimension, 0, tensors[name].shape[dimension] // 2)

    return altered


def doubles(tensors: Tensors) -> None:
    tensors["entity"] = tensors["entity"].double()


def a_little(tensors: Tensors) -> None:
    first = next(tensor for tensor in tensors.values() if tensor.is_floating_point()).view(-1)
    first[first.nonzero()[0]] += 1e-4


OF_TENSORS: list[tuple[str, Path, Callable[[Tensors], None], str | None]] = [
    ("seeds relabelled", THETA0, relabelled, "the sessions' seeds, 0, 1, got 1, 2"),
    ("seeds swapped", THETA0, seeds_swapped, "the sessions' seeds, 0, 1, got 1, 0"),
    ("rows shuffled", THETA0, rows_shuffled, "zeros for who is not known"),
    ("a novel entity inside D0", THETA0, novel_known, "who takes part then, and no novel entity"),
    ("a novel entity with a vector", THETA0, novel_with_a_vector, "zeros for who is not known"),
    ("not a number", THETA0, not_a_number, r"tensor 'entity', \[0, 1, 2\]: expected finite numbers"),
    ("a model less", THETA0, cut("entity", 0), "2 rows in every tensor"),
    ("an entity less", THETA0, cut("entity", 1), "tensor 'entity': expected float32 of shape"),
    ("vectors of half the length", THETA0, cut("entity", 2), "tensor 'relation': expected float32 of shape"),
    ("a relation less", THETA0, cut("relation", 1), "tensor 'relation': expected float32 of shape"),
    ("double precision", THETA0, doubles, "expected float32 .*, got float64"),
    ("another vector", THETA0, a_little, None),
    ("an infinite word vector", WORDS, infinite, "expected finite numbers"),
    ("half of the word vectors", WORDS, cut("vectors", 0), "tensor 'vectors': expected float32 of shape"),
    ("another word vector", WORDS, a_little, None),
]  # fmt: skip
