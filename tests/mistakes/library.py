"""Mistakes in the arguments of ``isi.insert``, ``isi.fit_new`` and of what an insertion gives."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import torch

from isi.models.distance import TransE
from tests.mistakes.calls import Called
from tests.small_embedding import KNOWN, TOLD, tables, words

NAN = np.float32("nan")
TABLES = tables()
ENTITIES, RELATIONS = TABLES["entities"], TABLES["relations"]
RAGGED: Any = [[1.0, 2.0], [1.0]]

INSERT_CASES = [
    Called("no table", {"entities": None}, "argument 'entities'"),
    Called("rows of several lengths", {"entities": RAGGED}, "argument 'entities'"),
    Called("a tensor that learns", {"entities": torch.ones(12, 8, requires_grad=True)}, "argument 'entities'"),
    Called("whole numbers", {"entities": ENTITIES.astype(int)}, "argument 'entities'"),
    Called("complex numbers", {"entities": ENTITIES + 1j}, "argument 'entities'"),
    Called("one vector", {"entities": ENTITIES[0]}, "argument 'entities'"),
    Called("NaN", {"entities": np.where(np.eye(12, 8) == 1, NAN, ENTITIES)}, "argument 'entities'|row 0"),
    Called("vectors that do not differ", {"entities": np.ones((12, 8), np.float32)}, "argument 'entities'"),
    Called("vectors that are too large for an initializer", {"entities": ENTITIES * np.float32(1e30),
           "initializer": "map_mean"}, "argument 'entities'"),
    Called("vectors that are too large for single precision", {"entities": ENTITIES.astype(float) * 1e300,
           "initializer": "mean"}, "argument 'entities'"),
    Called("infinity in relations", {"relations": np.full((3, 8), np.float32("inf"))}, "argument 'relations'|row 0"),
    Called("relations of another width", {"relations": RELATIONS[:, :4]}, "argument 'relations'"),
    Called("a width that the model does not have", {"entities": ENTITIES[:, :6]}, "argument 'model'|dimension 6"),
    Called("an unknown model", {"model": "transformer"}, "argument 'model'"),
    Called("a model that is none", {"model": 5}, "argument 'model'"),
    Called("a model by its class", {"model": TransE}, "argument 'model'"),
    Called("a model without its margin", {"model": "transe"}, "argument 'model'|margin"),
    Called("options of the model that are none", {"model_options": 5}, "argument 'model_options'"),
    Called("no list of triples", {"triples": 5}, "argument 'triples'"),
    Called("a text as triples", {"triples": "cup in e1"}, "argument 'triples'"),
    Called("a number as triple", {"triples": [5]}, "argument 'triples'|triple 0"),
    Called("half a triple", {"triples": [("cup", "in")]}, "argument 'triples'|triple 0"),
    Called("a mapping as triple", {"triples": [{"cup": 0, "in": 1, "e1": 2}]}, "argument 'triples'|triple 0"),
    Called("an unknown relation", {"triples": [("cup", "under", "e1")]}, "argument 'triples'|triple 0"),
    Called("an unknown entity", {"triples": [("cup", "in", "kup")]}, "argument 'triples'|triple 0"),
    Called("an id that is none", {"triples": [("cup", "in", True)]}, "argument 'triples'|triple 0"),
    Called("an id that is not there", {"triples": [(14, 0, 1)]}, "argument 'triples'|triple 0"),
    Called("the same in an array", {"triples": np.array([[12, 0, 1], [13, 3, 1]])}, "argument 'triples'|triple 1"),
    Called("an id below 0", {"triples": np.array([[12, 0, -1]])}, "argument 'triples'|triple 0"),
    Called("an array of two columns", {"triples": np.array([[12, 0]])}, "argument 'triples'"),
    Called("a triple of known entities", {"triples": [*TOLD, ("e1", "in", "e2")]}, "argument 'triples'|(e1, in, e2)"),
    Called("a known triple of a new entity", {"known_triples": TOLD[:1]}, "argument 'known_triples'|(cup, in, e1)"),
    Called("no list of known triples", {"known_triples": 5}, "argument 'known_triples'"),
    Called("nothing is known of an entity", {"triples": TOLD[:2]}, "new entity 'mug'"),
    Called("an entity is known by new ones alone", {"triples": [("cup", "in", "e1"), ("cup", "in", "mug")]},
           "new entity 'mug'"),
    Called("words of new entities alone", {"triples": TOLD[:2], "words": {"mug": [1.0], "cup": [2.0]}},
           "new entity 'mug'"),
    Called("no new entity", {"new": []}, "argument 'new'"),
    Called("no list of new entities", {"new": None}, "argument 'new'"),
    Called("a number where entities have names", {"new": 2}, "argument 'new'"),
    Called("names where entities have none", {"entity_names": None}, "argument 'new'"),
    Called("one name", {"new": "cup"}, "argument 'new'"),
    Called("a new name that is no text", {"new": ["cup", 7]}, "argument 'new'"),
    Called("a new name that is known", {"new": ["cup", "e3"]}, "argument 'entity_names'|'e3'"),
    Called("a new name twice", {"new": ["cup", "cup"]}, "argument 'entity_names'|'cup'"),
    Called("no list of names", {"entity_names": 5}, "argument 'entity_names'"),
    Called("a text as names", {"entity_names": "abcdefghijkl"}, "argument 'entity_names'"),
    Called("a name that is no text", {"entity_names": [*KNOWN[1:], 7]}, "argument 'entity_names'"),
    Called("a name too few", {"entity_names": KNOWN[1:]}, "argument 'entity_names'"),
    Called("names of relations that repeat", {"relation_names": ["in", "in", "on"]}, "argument 'relation_names'|'in'"),
    Called("too few names of relations", {"relation_names": ["in"]}, "argument 'relation_names'"),
    Called("a text as names of relations", {"relation_names": "ion"}, "argument 'relation_names'"),
    Called("words that are none", {"words": 5}, "argument 'words'"),
    Called("words of several lengths", {"words": RAGGED}, "argument 'words'"),
    Called("NaN in words", {"words": words()[:, :1] * NAN}, "argument 'words'|row 0"),
    Called("words that are too large for single precision", {"words": words().astype(float) * 1e300},
           "argument 'words'|row 0"),
    Called("words of one entity too few", {"words": words()[1:]}, "argument 'words'"),
    Called("words by name, of several lengths", {"words": {"cup": [1, 2], "mug": [1]}}, "argument 'words'|'mug'"),
    Called("NaN in words by name", {"words": {"cup": [1, NAN]}}, "argument 'words'|'cup'"),
    Called("words by name that are no vector", {"words": {"cup": RAGGED}}, "argument 'words'|'cup'"),
    Called("words of an unknown entity", {"words": {"kup": [1.0]}}, "argument 'words'"),
    Called("texts without a source of vectors", {"words": {"cup": "a cup"}}, "argument 'words'"),
    Called("a source of vectors that is none", {"words": {"cup": "a cup"}, "word_source": 3},
           "argument 'word_source'"),
    Called("a name where there are none", {"entity_names": None, "new": 1}, "argument 'triples'|triple 0"),
    Called("a file of vectors that is not there", {"words": {"cup": "a cup"}, "word_source": Path("none.txt")},
           "none.txt"),
    Called("a source that gives no vectors", {"words": {"cup": "a cup"}, "word_source": lambda _texts: "none"},
           "argument 'word_source'"),
    Called("a source that gives nothing", {"words": {"cup": "a cup"}, "word_source": lambda _texts: None},
           "argument 'word_source'"),
    Called("a source that gives too many", {"words": {"cup": "a cup"}, "word_source": lambda _texts: np.eye(2)},
           "argument 'word_source'"),
    Called("too few kinds", {"kinds": ["a"]}, "argument 'kinds'"),
    Called("no list of kinds", {"kinds": 5}, "argument 'kinds'"),
    Called("a text as kinds", {"kinds": "objects, rooms"}, "argument 'kinds'"),
    Called("the kind of an unknown entity", {"kinds": {"kup": "object"}}, "argument 'kinds'"),
    Called("an unknown initializer", {"initializer": "er"}, "argument 'initializer'"),
    Called("an initializer that is none", {"initializer": 5}, "argument 'initializer'"),
    Called("an option out of range", {"initializer": "es", "options": {"k": 0}}, "argument 'initializer'|k"),
    Called("an option that the initializer does not have", {"initializer": "mean", "options": {"k": 1}},
           "argument 'initializer'|k"),
    Called("options that are none", {"initializer": "es", "options": 5}, "argument 'options'"),
    Called("an initializer that does not serve the model", {"initializer": "ridge", "model": "transe",
           "model_options": {"margin": 1.0, "squared": False}}, "argument 'initializer'|ridge"),
    Called("a seed below 0", {"seed": -1}, "argument 'seed'"),
    Called("a seed that is none", {"seed": "a"}, "argument 'seed'"),
]  # fmt: skip

FIT_CASES = [
    Called("triples of known entities", {"triples": [("e1", "in", "e2")]}, "argument 'triples'"),
    Called("no triples", {"triples": []}, "argument 'triples'"),
    Called("no list of triples", {"triples": None}, "argument 'triples'"),
    Called("known triples of new entities", {"known_triples": TOLD}, "argument 'known_triples'"),
    Called("no new entity", {"new": 0}, "argument 'new'"),
    Called("more new entities than there are rows", {"new": 14}, "argument 'new'"),
    Called("a list of new entities", {"new": ["cup", "mug"]}, "argument 'new'"),
    Called("no epochs", {"epochs": 0}, "argument 'epochs'"),
    Called("epochs that are no number", {"epochs": "ten"}, "argument 'epochs'"),
    Called("epochs below 0", {"all_epochs": -1}, "argument 'all_epochs'"),
    Called("all rows on new triples alone", {"all_epochs": 1}, "argument 'all_epochs'"),
    Called("a learning rate below 0", {"learning_rate": -1.0}, "fit_new|learning_rate"),
    Called("a learning rate with which it diverges", {"learning_rate": 1e30}, "fit_new"),
    Called("a ratio of none", {"ratio": 0}, "fit_new|ratio"),
    Called("a batch that is no number", {"batch_size": None}, "fit_new|batch_size"),
    Called("a model without its margin", {"model": "rotate"}, "argument 'model'|margin"),
    Called("a seed that is none", {"seed": 1.5}, "argument 'seed'"),
]  # fmt: skip

REPORT_CASES = [
    Called("a number below 0", {"nearest": -1}, "argument 'nearest'"),
    Called("a number that is none", {"nearest": "all"}, "argument 'nearest'"),
]  # fmt: skip

INTERFERENCE_CASES = [
    Called("triples of new entities", {"triples": TOLD}, "argument 'triples'"),
    Called("no list of triples", {"triples": 5}, "argument 'triples'"),
    Called("no triple at most", {"most": 0}, "argument 'most'"),
    Called("a seed that is none", {"seed": None}, "argument 'seed'"),
]  # fmt: skip
