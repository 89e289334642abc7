"""Mistakes in the arguments of ``isi.insert`` and of the methods of ``Inserted``."""

from typing import Any

import numpy as np

from isi.checks.initializers import ScoreAlone
from isi.errors import short
from isi.models.distance import TransE
from tests.mistakes.calls import Called
from tests.small_embedding import KNOWN, TRIPLES, tables, words

NAN = np.float32("nan")
TABLES = tables()
ENTITIES, RELATIONS = TABLES["entities"], TABLES["relations"]
RAGGED: Any = [[1.0, 2.0], [1.0]]
LARGE = words().astype(float) * 1e300


def wrong(argument: str, *values: Any, place: str = "", **others: Any) -> list[Called]:
    """Cases of refused values of an argument; ``place``: the part of the
    argument that the message names.
    """
    names = f"argument {argument!r}|{place}"
    return [
        Called(f"{argument} {short(value)}", {argument: value, **others}, names) for value in values
    ]


INSERT_CASES = [
    *wrong(
        "entities",
        None,
        RAGGED,
        ENTITIES.astype(int),
        ENTITIES + 1j,
        ENTITIES[0],
    ),
    *wrong("entities", np.ones((12, 8), np.float32), initializer="map"),
    *wrong("entities", np.where(np.eye(12, 8) == 1, NAN, ENTITIES), place="row 0"),
    *wrong("entities", ENTITIES * np.float32(1e30), initializer="map"),
    *wrong("entities", ENTITIES.astype(float) * 1e300, initializer="mean"),
    *wrong("relations", np.full((3, 8), np.float32("inf")), place="row 0"),
    *wrong("relations", RELATIONS[:, :4]),
    Called(
        "a width that the model does not have",
        {"entities": ENTITIES[:, :6]},
        "argument 'model'|dimension 6",
    ),
    *wrong("model", "transformer", 5, TransE),
    *wrong("model", "transe", place="margin"),
    *wrong("model_options", 5),
    *wrong("triples", 5, "cup in e1", np.array([[12, 0]])),
    *wrong(
        "triples",
        [5],
        [("cup", "in")],
        [{"cup": 0, "in": 1, "e1": 2}],
        [("cup", "under", "e1")],
        [("cup", "in", "kup")],
        [("cup", "in", True)],
        [(14, 0, 1)],
        np.array([[12, 0, -1]]),
        place="triple 0",
    ),
    *wrong("triples", np.array([[12, 0, 1], [13, 3, 1]]), place="triple 1"),
    *wrong("triples", np.array([("cup", "in", "e1")], "U4, U4, U4"), place="DataFrame"),
    *wrong("triples", {"cup": ["e1"]}, {"cup": 5}, place="'cup'"),
    *wrong("triples", {"cup": {"IN": "e1"}}, place="did you mean 'in'"),
    *wrong("triples", [*TRIPLES, ("cup", "inn", "e1")], place="triple 4|new_relations"),
    *wrong("confidence", [1.0], [0.0] * 99, [1.5], np.ones((1, 3)), [np.nan]),
    *wrong("validation", [("e0", "in", "cup")], [("e0", "under", "e1")], [(12, 0, 1)], 5),
    *wrong("triples", [*TRIPLES, ("e1", "in", "e2")], place="(e1, in, e2)"),
    *wrong("triples", TRIPLES, entity_names=None, new=1, place="triple 0"),
    *wrong("known_triples", TRIPLES[:1], place="(cup, in, e1)"),
    *wrong("known_triples", 5),
    *wrong("known_triples", [("e1", "holds", "e2")], new_relations=["holds"]),
    *wrong("new_relations", ["in"], place="'in'|known already"),
    Called("nothing is known of an entity", {"triples": TRIPLES[:2]}, "new entity 'mug'"),
    Called(
        "an entity has a triple with itself alone",
        {"triples": [("cup", "in", "e1"), ("mug", "in", "mug")]},
        "new entity 'mug'",
    ),
    Called(
        "words of new entities alone",
        {"triples": TRIPLES[:2], "words": {"mug": [1.0], "cup": [2.0]}},
        "new entity 'mug'",
    ),
    *wrong("new", None, 2, "cup", ["cup", 7]),
    Called("new []", {"new": [], "triples": []}, "argument 'new'"),
    Called("names where entities have none", {"entity_names": None}, "argument 'new'"),
    Called("a new name that is known", {"new": ["cup", "e3"]}, "argument 'new'|'e3'|known"),
    Called("a new name twice", {"new": ["cup", "cup"]}, "argument 'new'|'cup'"),
    *wrong("entity_names", 5, "abcdefghijkl", [*KNOWN[1:], 7], KNOWN[1:]),
    *wrong("relation_names", ["in"], "ion"),
    *wrong("relation_names", ["in", "in", "on"], place="'in'"),
    *wrong("words", 5, RAGGED, words()[1:], {"kup": [1.0]}, {"cup": "a cup"}),
    *wrong("words", words()[:, :1] * NAN, LARGE, place="row 0"),
    *wrong("words", {"cup": [1, NAN]}, {"cup": RAGGED}, place="'cup'"),
    *wrong("words", {"cup": [1, 2], "mug": [1]}, place="'mug'"),
    *wrong("embedder", 3, words={"cup": "a cup"}),
    *(
        Called(
            f"a word source that gives {short(vectors)}",
            {"words": {"cup": "a cup"}, "embedder": lambda _texts, vectors=vectors: vectors},
            "argument 'embedder'",
        )
        for vectors in ("none", None, np.eye(2))
    ),
    *wrong("kinds", ["a"], 5, "objects, rooms", {"kup": "object"}),
    *wrong("initializer", "er", 5),
    *wrong("initializer", "es", options={"k": 0}, place="k"),
    *wrong("initializer", "mean", options={"k": 1}, place="k"),
    *wrong("initializer", "rs", model=ScoreAlone(), place="rs"),
    *wrong("options", 5, initializer="es"),
    *wrong("seed", -1, "a"),
]

TRAIN_CASES = [
    *wrong("epochs", 0, "ten"),
    Called("an option that there is not", {"speed": 1.0}, "speed"),
]

REPORT_CASES = wrong("nearest", -1, "all")

INTERFERENCE_CASES = [
    *wrong("triples", TRIPLES, 5),
    *wrong("most", 0),
    *wrong("seed", None),
    *wrong("show", -1),
    *wrong("original", 0, 13, 2.5, True),
]
