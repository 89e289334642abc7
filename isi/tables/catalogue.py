"""The tables of the pipeline: the columns of each, and the rules that its rows hold."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import pandas as pd
import pyarrow as pa

from isi.errors import NotAsWritten
from isi.tables.rules import (
    Rule,
    ascending,
    at_least,
    counted,
    finite,
    first_breach,
    in_blocks,
    mean_of,
    measured,
    named,
    not_above,
    one_of,
    present,
    unique,
    within,
)

Fields = Sequence[tuple[str, pa.DataType]]


@dataclass(frozen=True, eq=False)
class Schema:
    """The columns of a table, in their order, and what its rows hold."""

    fields: Fields
    rules: Sequence[Rule] = ()
    #: columns that may lack values
    nullable: Sequence[str] = ()

    @cached_property
    def columns(self) -> pa.Schema:
        return pa.schema(self.fields)

    @property
    def names(self) -> list[str]:
        return [name for name, _ in self.fields]

    def check(self, frame: pd.DataFrame, path: Path) -> None:
        """See that the rows of a table hold the rules.

        Raises:
            NotAsWritten: naming the first row of the file that breaks one, from 0 as ids are, and the rule.
        """
        required = present(*(name for name in self.names if name not in self.nullable))
        breach = first_breach(frame, [*required, *self.rules])
        if breach:
            raise NotAsWritten(path, *breach)


_NAME = pa.dictionary(pa.int32(), pa.string())
_INT, _LONG, _REAL, _TEXT = pa.int32(), pa.int64(), pa.float64(), pa.string()

#: What a triple is to a session that it takes part in.
SPLIT_NAMES = ("train", "valid", "test")
SCOPES = ("all", "known", "known_closed", "novel", "novel_heldout")
#: What an initializer without the knowledge that it needs falls back to.
FALLBACK_NAMES = ("es", "rs", "centroid")
FILTERS = ("learned", "true")
SLOTS = ("head", "relation", "tail")
#: The ends of a triple, one of which a query hides; and what a true answer is to a session.
ENDS = ("tail", "head")
TRUE_NAMES = ("told", "learned", "held_out")
#: What is asked of entities that were hidden from another trainer (``HIDDEN``).
ASKED_OF_HIDDEN = ("known", "hidden", "earlier")
#: Where a query has a novel entity.
NOVEL_AT = ("none", "given", "answer", "both")

_MEASURES = ("mrr_star", "mrr_star_entity", "mrr_star_relation", "mrr")
_HALVES = mean_of(*_MEASURES[:3])
_CELL: Fields = [("size", _INT), ("seed", _INT)]
_OF_CELLS = [*at_least(1, "size"), *at_least(0, "seed")]
_OF_SESSIONS = [*_OF_CELLS, *at_least(1, "session")]
_FIELDS_OF_MEASURES: Fields = [(name, _REAL) for name in _MEASURES]

OBSERVATIONS = Schema(
    [("scene", _NAME), ("room", _NAME), ("instance", _TEXT), ("head", _NAME), ("relation", _NAME), ("tail", _NAME),
     ("count", _INT)],
    [*named("room", "head", "relation", "tail"), *counted()],
    nullable=["scene", "room", "instance"],
)  # fmt: skip
#: Entities of a source, and how many instances each step of mining it left.
KINDS = Schema(
    [("entity", _TEXT), ("kind", _NAME), ("phrase", _TEXT)], [*named("entity", "kind", "phrase"), *unique("entity")]
)
MINED = Schema([("step", _TEXT), ("instances", _LONG)], [*unique("step"), *at_least(0, "instances")])
#: Row numbers are ids, here and of triples: rows behind each other by source, first the one that others extend.
ENTITIES = Schema(
    [("entity", _TEXT), ("kind", _NAME), ("source", _NAME), ("phrase", _TEXT)],
    [*named("entity", "kind", "source", "phrase"), *unique("entity"), *in_blocks("source", "entity")],
)
TRIPLES = Schema(
    [("head", _NAME), ("relation", _NAME), ("tail", _NAME), ("count", _INT), ("source", _NAME)],
    [*named("head", "relation", "tail", "source"), *counted(), *unique("head", "relation", "tail"),
     *in_blocks("source", "head", "relation", "tail")],
)  # fmt: skip
COVERAGE = Schema([("entity", _TEXT), ("phrase", _TEXT), ("served_by", _TEXT)], unique("entity"), ["served_by"])
SPLITS = Schema(
    [("seed", _INT), ("triple", _INT), ("split", _NAME)],
    [*at_least(0, "seed", "triple"), *one_of("split", SPLIT_NAMES), *ascending("seed", "triple")],
)
#: ``session``: the one that inserts the entity, from 1; Θ⁰ is learned in session 0.
NOVEL = Schema(
    [*_CELL, ("entity", _INT), ("session", _INT)],
    [*_OF_SESSIONS, *at_least(0, "entity"), *ascending("size", "seed", "session", "entity"),
     *unique("size", "seed", "entity")],
)  # fmt: skip
INSERT_TRIPLES = Schema(
    [*_CELL, ("entity", _INT), ("triple", _INT), ("session", _INT)],
    [*_OF_SESSIONS, *at_least(0, "entity", "triple"), *ascending("size", "seed", "session", "entity", "triple")],
)
#: Size 0 stands for the joint model.
TRAINING_LOG = Schema(
    [*_CELL, ("epoch", _INT), *_FIELDS_OF_MEASURES, ("kept", pa.bool_())],
    [*at_least(0, "size", "seed"), *at_least(1, "epoch"), *ascending("size", "seed", "epoch"),
     *within(0, 1, *_MEASURES), *_HALVES],
    nullable=_MEASURES,  # of a model that has nothing to validate it by
)  # fmt: skip


def _runs(by: Fields = (), more: Sequence[Rule] = ()) -> Schema:
    """Runs of the models of each cell, told apart by columns of their own."""
    key = [name for name, _ in by]
    return Schema(
        [*by, *_CELL, ("epoch", _INT), ("scope", _NAME), *_FIELDS_OF_MEASURES, ("queries", _INT), ("session", _INT)],
        [*more, *_OF_SESSIONS, *at_least(0, "epoch"), *one_of("scope", SCOPES), *measured(_MEASURES, "queries"),
         *_HALVES, *ascending(*key, "size", "seed", "session", "epoch", "scope")],
        nullable=_MEASURES,
    )  # fmt: skip


#: ``queries`` counts triples, of each of which head, tail and relation are asked for.
RUNS = _runs()
#: One row per inserted entity: its own queries of scope ``novel`` at once, and what it fell back to.
INSERTED = Schema(
    [*_CELL, ("entity", _INT), ("kind", _NAME), ("fallback", _NAME), *_FIELDS_OF_MEASURES, ("queries", _INT),
     ("ties", _INT), ("session", _INT)],
    [*_OF_SESSIONS, *at_least(0, "entity", "ties"), *named("kind"), *one_of("fallback", FALLBACK_NAMES),
     *measured(_MEASURES, "queries"), *_HALVES, *ascending("size", "seed", "session", "entity")],
    nullable=["fallback", *_MEASURES],
)  # fmt: skip
#: Runs with indicator sets of several sizes, and at multiples of the fine-tuning rate.
INDICATOR_SWEEP = _runs([("k", _INT)], at_least(1, "k"))
RATE_SWEEP = _runs([("factor", _REAL)], at_least(0, "factor"))
#: One row per setting and fold: the best look at the fold held out.
CROSS_VALIDATION = Schema(
    [("dimension", _INT), ("ratio", _INT), ("learning_rate", _REAL), ("weight_decay", _REAL), ("fold", _INT),
     *_FIELDS_OF_MEASURES, ("epoch", _INT)],
    [*at_least(1, "dimension", "ratio", "epoch"), *at_least(0, "learning_rate", "weight_decay", "fold"),
     *within(0, 1, *_MEASURES), *_HALVES,
     *ascending("dimension", "ratio", "learning_rate", "weight_decay", "fold")],
)  # fmt: skip
#: Measures of the joint model of each embedding family.
FAMILIES = Schema(
    [("seed", _INT), ("epochs", _INT), *_FIELDS_OF_MEASURES, ("valid_mrr_star", _REAL), ("queries", _INT)],
    [*at_least(0, "seed"), *at_least(1, "epochs"), *within(0, 1, "valid_mrr_star"), *measured(_MEASURES, "queries"),
     *_HALVES, *unique("seed")],
    nullable=_MEASURES,
)  # fmt: skip
#: Rank of each answer to (entity, relation, ?) right after insertion.
AFFORDANCES = Schema(
    [("initializer", _NAME), ("seed", _INT), ("entity", _INT), ("answer", _INT), ("rank", _INT)],
    [*at_least(0, "seed", "entity", "answer"), *at_least(1, "rank")],
)  # fmt: skip


def _asked(by: Fields = ()) -> Schema:
    """What models answer, told apart by columns of their own."""
    key = ("size", "seed", "session", "model", "scope", "filter", "relation", "hidden", "novel")
    return Schema(
        [*by, *_CELL, ("session", _INT), ("model", _NAME), ("scope", _NAME), ("filter", _NAME), ("relation", _NAME),
         ("hidden", _NAME), ("novel", _NAME), ("queries", _INT), ("mrr_star", _REAL), ("mrr", _REAL),
         ("observations", _LONG)],
        [*_OF_SESSIONS, *one_of("scope", SCOPES), *one_of("filter", FILTERS), *one_of("hidden", SLOTS),
         *one_of("novel", NOVEL_AT), *at_least(1, "queries", "observations"), *within(0, 1, "mrr_star", "mrr"),
         *unique(*(name for name, _ in by), *key)],
    )  # fmt: skip


#: Queries right after insertion, grouped by what is asked; MRR* and MRR are means over them. ``filter``: ``learned``,
#: the scope's own, or ``true``, all true triples. ``hidden``: the slot that is asked for. ``novel``: where a novel
#: entity is (``given``, hidden as the ``answer``, ``both``, ``none``). ``observations``: the relation's in D¹, its
#: weight in equation 7.
ASKED = _asked()
_OF_EXPERIMENTS: Fields = [("experiment", _NAME), ("model", _NAME)]
#: Runs of each model of experiments under other conditions, the joint model's among them, and their answers at once.
VARIANTS = _runs(_OF_EXPERIMENTS)
VARIANTS_ASKED = _asked(_OF_EXPERIMENTS[:1])
#: Coordinates of relations that are not zero: of each relation, and (null) of any of them.
USED = Schema(
    [("seed", _INT), ("model", _NAME), ("relation", _NAME), ("part", _NAME), ("used", _INT), ("of", _INT)],
    [*at_least(0, "seed", "used"), *not_above("used", "of"), *unique("seed", "model", "relation", "part")],
    nullable=["relation"],
)
#: Rivals whose score is tied with the answer's, at epoch 0.
TIES = Schema(
    [*_CELL, ("scope", _NAME), ("ties", _INT), ("session", _INT)],
    [*_OF_SESSIONS, *at_least(0, "ties"), *one_of("scope", SCOPES), *ascending("size", "seed", "session", "scope")],
)
#: Single insertions, one row per entity. ``told``: its insert triples. ``shown``: the share of the known entities'
#: variance that the two axes of its map hold. ``fitted``: the share of it that the joint model's vectors of them have
#: in common with Θ⁰'s.
SINGLES = Schema(
    [("entity", _INT), ("seed", _INT), ("told", _INT), ("shown", _REAL), ("fitted", _REAL)],
    [*at_least(0, "entity", "seed", "told"), *within(0, 1, "shown", "fitted"), *ascending("entity")],
)
#: Whose vectors make the centre of an entity's vector, by weight; ``fallback``: by whose means, where not the model's
#: own. ``by_words``: cosine of word vectors; ``by_relations``: mean of cos(v_e, ᾱ_r) over the relations told.
SINGLE_INDICATORS = Schema(
    [("entity", _INT), ("model", _NAME), ("fallback", _NAME), ("indicator", _INT), ("weight", _REAL),
     ("by_words", _REAL), ("by_relations", _REAL)],
    [*at_least(0, "entity", "indicator"), *one_of("fallback", FALLBACK_NAMES), *within(0, 1, "weight"),
     *within(-1, 1, "by_words", "by_relations"), *unique("entity", "model", "indicator")],
    nullable=["fallback", "by_words", "by_relations"],
)  # fmt: skip
#: Where entities lie on the map of a seed: the known ones in Θ⁰, others where a model has them after an epoch.
SINGLE_PLACES = Schema(
    [("seed", _INT), ("entity", _INT), ("model", _NAME), ("epoch", _INT), ("x", _REAL), ("y", _REAL)],
    [*at_least(0, "seed", "entity", "epoch"), *finite("x", "y"), *unique("seed", "entity", "model", "epoch")],
)
#: Answers to (entity, relation, ?) and (?, relation, entity), the first and the true ones, with their places among all
#: entities of the session. ``true``: what a true one is; null: not true.
SINGLE_ANSWERS = Schema(
    [("entity", _INT), ("model", _NAME), ("epoch", _INT), ("relation", _NAME), ("hidden", _NAME), ("answer", _INT),
     ("rank", _INT), ("true", _NAME)],
    [*at_least(0, "entity", "epoch", "answer"), *at_least(1, "rank"), *one_of("hidden", ENDS),
     *one_of("true", TRUE_NAMES), *unique("entity", "model", "epoch", "relation", "hidden", "answer"),
     *unique("entity", "model", "epoch", "relation", "hidden", "rank")],
    nullable=["true"],
)  # fmt: skip
#: ``method``: what gave hidden entities their vectors. ``initializer``: of ``isi.pykeen.insert``, where that did.
#: ``told``: triples told of each entity, at most (null: all). ``asked``: for the ``known`` end of a triple by its
#: hidden entity, for the ``hidden`` entity by the known end, or for the ends of ``earlier`` triples, of known entities
#: alone, which were not trained on; all entities are candidates of all.
HIDDEN = Schema(
    [("method", _NAME), ("initializer", _NAME), ("told", _INT), ("seed", _INT), ("asked", _NAME), ("entities", _INT),
     ("queries", _INT), ("mrr", _REAL), ("hits_at_10", _REAL)],
    [*at_least(1, "told", "entities", "queries"), *at_least(0, "seed"), *one_of("asked", ASKED_OF_HIDDEN),
     *within(0, 1, "mrr", "hits_at_10"), *unique("method", "initializer", "told", "seed", "asked")],
    nullable=["initializer", "told"],
)  # fmt: skip
