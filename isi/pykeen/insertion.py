"""``insert``: a copy of a model of PyKEEN with new entities."""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Annotated, Any

import numpy as np
import torch
from pydantic import Field
from pykeen.pipeline import PipelineResult
from pykeen.triples import CoreTriplesFactory, TriplesFactory, TriplesNumericLiteralsFactory

from isi.config import check, is_whole
from isi.errors import InputError, short
from isi.graph.graph import HEAD, RELATION, TAIL
from isi.initializers.inverses import InverseRelations, pack
from isi.insertion.api import insert_request
from isi.insertion.arguments import Embedder, listed_triples, naming_argument, triples_of
from isi.insertion.request import InsertRequest, KnownEmbedding
from isi.insertion.result import Inserted
from isi.models.losses import Loss, TrainingLoss
from isi.models.model import Model
from isi.models.stack import Embedding, usual_torch
from isi.pykeen import reading
from isi.pykeen.reading import PykeenModel, copied, read_model, stored, tables_of, unwrapped
from isi.vocabulary import Vocabulary, names_by_id

#: What serves facts about entities that are known.
FURTHER_FACTS = (
    "isi.pykeen.train_on trains known rows on further facts, "
    "isi.from_pykeen observes, removes and inserts again"
)


@dataclass(frozen=True, eq=False, repr=False)
class EnlargedModel:
    """A model of PyKEEN's with new entities, as ``isi.pykeen.insert`` returns it.

    ``larger, more = ...`` unpacks ``model`` and ``factory``, which PyKEEN can predict with,
    evaluate and save.

    Example:
        >>> new = isi.pykeen.insert(model, factory, [("mug", "in", "kitchen")], choose=False)
        >>> new.initializer, new.harm, new.vectors.shape
        ('fold_in', None, (1, 4))
        >>> new.model.num_entities, new.factory.entity_to_id["mug"]
        (5, 4)
        >>> trained = new.train(epochs=2)
        >>> bool((trained.vectors != new.vectors).any())
        True
    """

    rows: Inserted  #: the result of ``isi.insert``: report, probability, interference
    _trained: tuple[PykeenModel, CoreTriplesFactory]

    @cached_property
    @usual_torch()
    def model(self) -> PykeenModel:
        """A copy of the model, made on first use, with the vectors of new entities and relations as
        last rows.
        """
        details = self.rows.details
        new_relations = details.relations[details.new_relations]
        return add_rows(self._trained[0], details.vectors, new_relations, details.model)

    @cached_property
    def factory(self) -> CoreTriplesFactory:
        """A copy of the factory, made on first use, with new labels and triples."""
        details, factory = self.rows.details, self._trained[1]
        known = factory.mapped_triples.numpy()
        triples = np.concatenate([known, details.insert_triples, details.between])
        return larger_factory(factory, triples, details.names, details.labels)

    @property
    def vectors(self) -> np.ndarray:
        """Rows of the new entities, those of several tables joined; shape (n, d)."""
        return self.rows.vectors

    @property
    def initializer(self) -> str:
        return self.rows.initializer

    @property
    def harm(self) -> float | None:
        """The loss of MRR of earlier triples that the selection expects; None without one."""
        return self.rows.harm

    def train(self, epochs: int = 5, **options: Any) -> EnlargedModel:
        """The same after further training of the new rows together by the model's own loss
        (``Inserted.train``). All other rows stay as they are.
        """
        return replace(self, rows=self.rows.train(epochs, **options))

    def __iter__(self) -> Iterator[Any]:
        yield self.model
        yield self.factory

    def __repr__(self) -> str:
        return repr(self.rows)


@usual_torch()
def insert(
    model: PykeenModel | PipelineResult,
    factory: Any = None,
    triples: Any = None,
    *,
    new: int | Sequence[str] | None = None,
    words: Any = None,
    kinds: Any = None,
    margin: float | None = None,
    initializer: str | None = None,
    options: Mapping[str, Any] | None = None,
    trained_with: Loss | TrainingLoss | None = None,
    harm: float = 0.01,
    choose: bool = True,
    validation: Any = None,
    seed: int = 0,
    new_relations: int | Sequence[str] = 0,
    embedder: Embedder | None = None,
    confidence: Sequence[float] | np.ndarray | None = None,
) -> EnlargedModel:
    """Insert new entities or relations into a copy of a trained model:
    ``insert(model, factory, triples)``.

    Known vectors stay unchanged. To train new rows further, use ``train`` of the result; to train
    all, ``train_on``: PyKEEN's own ``train`` starts again from random vectors.

    Args:
        model: stores the vectors of entities in tables, as most models do, perhaps within a wrapper
            of ``torch.compile`` or ``DataParallel``, which copies lack. DistMult, ComplEx,
            TransE (L1, L2, squared) and RotatE work with all initializers, others with those that
            need no inverse (map, mean, es, ...). Or the result of PyKEEN's pipeline:
            ``insert(result, triples)``.
        factory: the triples factory that the model was trained on.
        triples: of the new entities and relations, as labels (if the factory has labels) or ids, in
            any form of ``isi.insert``; or another triples factory.
        new: labels of the new entities (None: all labels in ``triples`` that the factory lacks,
            with a warning if one is nearly a known label, and an error if it has no triple with a
            known entity, either); their number if the factory has no labels.
        words, kinds: see ``isi.insertion.request.InsertRequest``, with labels for names.
        margin: added to scores (except of DistMult and ComplEx), so that score 0 means probability
            ½; None: estimated from scores of the factory's triples and of corrupted ones.
        trained_with: the loss of training; None: that of the model.
        validation: triples of known entities that were not trained on, in the forms of ``triples``:
            harm is measured on them.
        new_relations: labels, or their number if the factory has no labels; the model needs tables
            of relations, and triples of new relations may lie between known entities.
        initializer: this and all others are those of ``isi.insert``.

    Returns:
        an ``EnlargedModel``: its ``model`` and ``factory`` are copies with the new entities and
        relations. With inverse triples, each triple counts in both directions, and a new relation
        has two rows, its own and that of its inverse. Numeric literals of new entities are zero, as
        PyKEEN sets those of entities without literals.

    Raises:
        InputError: names the wrong argument or new entity, and the expected value.
        TypeError: names an argument that there is not.

    Example:
        >>> import isi, numpy as np
        >>> from pykeen.models import DistMult
        >>> from pykeen.triples import TriplesFactory
        >>> facts = np.array([("cup", "in", "kitchen"), ("bed", "in", "bedroom")])
        >>> factory = TriplesFactory.from_labeled_triples(facts)
        >>> model = DistMult(triples_factory=factory, embedding_dim=4, random_seed=0)
        >>> larger, more = isi.pykeen.insert(model, factory, [("mug", "in", "kitchen")])
        >>> larger.num_entities, more.num_triples
        (5, 3)
    """
    check(margin, Annotated[float, Field(allow_inf_nan=False)] | None, "", "argument 'margin'")  # type: ignore[arg-type]
    model, factory, triples = of_result(model, factory, triples)
    tables_of(model)
    vocabularies = vocabularies_of(model, factory)
    facts = _facts_of(model, vocabularies, triples, new, new_relations)
    embedding = read_model(model, factory.mapped_triples, margin)
    embedding = pack(embedding) if model.use_inverse_triples else embedding
    known = _known_embedding(embedding, factory, vocabularies)
    with naming_argument("validation"):
        held_out = None if validation is None else labelled(validation)
    with _suggesting(facts.near):
        request = InsertRequest(
            triples=facts.ids,
            new=facts.new,
            words=words,
            kinds=kinds,
            initializer=initializer,
            options=options,
            trained_with=trained_with or reading.loss_of(model, embedding.model),
            harm=harm,
            choose=choose,
            validation=held_out,
            seed=seed,
            new_relations=new_relations,
            embedder=embedder,
            confidence=confidence,
        )
        done = insert_request(known, request, stacklevel=5)
    for label, other in facts.near.items():
        warnings.warn(
            f"new entity {label!r}: did you mean {other!r}, which is known? ('new' lists new ones)",
            stacklevel=4,
        )
    return EnlargedModel(done, (model, factory))


@dataclass(frozen=True)
class _NewFacts:
    """Triples of new entities and relations of a model."""

    ids: np.ndarray  #: shape: (T, 3)
    new: int | Sequence[str]  #: labels of new entities, or their number
    near: Mapping[str, str]  #: by new label that the caller did not list, a known one like it


def _facts_of(
    model: PykeenModel,
    vocabularies: tuple[Vocabulary, Vocabulary],
    triples: Any,
    new: int | Sequence[str] | None,
    new_relations: int | Sequence[str],
) -> _NewFacts:
    """The triples in ids, and the new labels in them if ``new`` is None; ``InputError`` for one
    with nothing new.

    ``vocabularies``: of known entities and relations.
    """
    known_entities, known_relations = vocabularies
    relations = known_relations.with_new(new_relations, "new_relations")
    has_new_relations = relations.number > known_relations.number
    if has_new_relations:
        reading.relation_tables_of(model)
    with naming_argument("triples"):
        rows = labelled(triples)
    near = {}
    if new is None:
        new = _new_labels(rows, known_entities, relations, has_new_relations)
        near = known_entities.misspelt(new)
    names = known_entities.with_new(new, "new")
    ids = triples_of(rows, "triples", names, relations)
    _check_new(ids, names, relations, known_relations.number, known_entities.number, near)
    return _NewFacts(ids, new, near)


def _known_embedding(
    embedding: Embedding, factory: CoreTriplesFactory, vocabularies: tuple[Vocabulary, Vocabulary]
) -> KnownEmbedding:
    """The vectors of a model, with the labels and triples of its factory."""
    entities, relations = vocabularies
    return KnownEmbedding(
        embedding.entity[0].numpy(),
        embedding.relation[0].numpy(),
        embedding.model,
        entity_names=entities.names,
        relation_names=relations.names,
        triples=factory.mapped_triples.numpy(),
        numbers_are_ids=True,
    )


@contextmanager
def _suggesting(near: Mapping[str, str]) -> Iterator[None]:
    """Add to an ``InputError`` about a new entity the known label that it is near to."""
    try:
        yield
    except InputError as error:
        if not near or not error.file.startswith("new entity"):
            raise
        label = next((label for label in near if repr(label) in error.file), next(iter(near)))
        hint = f"for {label!r}, did you mean {near[label]!r}?"
        raise InputError(error.file, error.place, f"{error.message}; {hint}") from error


def _check_new(
    triples: np.ndarray,
    names: Vocabulary,
    relations: Vocabulary,
    known_relations: int,
    known_entities: int,
    near: Mapping[str, str],
) -> None:
    """InputError for triples of ids, (T, 3), one of which has nothing new, or which join none of
    the new labels that are ``near`` a known one to a known entity.
    """
    has_known = (triples[:, [HEAD, TAIL]] < known_entities).any(1)
    joined = triples[has_known][:, [HEAD, TAIL]]
    for label, other in near.items():
        if not (joined == names.ids[label]).any():
            expected = f"expected a triple of the new entity {label!r} with a known one"
            problem = f"did you mean {other!r}, which is known? ('new' lists new ones)"
            raise InputError("argument 'triples'", "", f"{expected}: {problem}")
    known = (triples[:, [HEAD, TAIL]] < known_entities).all(1) & (
        triples[:, RELATION] < known_relations
    )
    for head, relation, tail in triples[known][:1].tolist():
        triple = f"({names.of(head)}, {relations.of(relation)}, {names.of(tail)})"[:200]
        raise InputError(
            "argument 'triples'",
            triple,
            f"expected a new entity or relation, but all are known already: {FURTHER_FACTS}",
        )


def add_rows(
    model: PykeenModel, entities: np.ndarray, relations: np.ndarray, read: Model
) -> PykeenModel:
    """A copy of a model with further rows of entities, (n, d), and relations, (q, w), as they are
    in the model ``read``.
    """
    larger: PykeenModel = copied(unwrapped(model))
    base, ways = (read.base, 2) if isinstance(read, InverseRelations) else (read, 1)
    larger.num_entities += len(entities)
    larger.num_relations += ways * len(relations)
    grown = stored(tables_of(larger), torch.from_numpy(entities))
    if len(relations):
        rows = torch.from_numpy(relations).view(ways * len(relations), -1)
        grown += stored(reading.relation_tables_of(larger), reading.table_rows(base, rows))
    for table, added in grown:
        weight = table._embeddings.weight
        # same Parameter: regularizers may refer to it
        weight.data, weight.grad = torch.cat([weight.data, added]), None
        table.max_id = table._embeddings.num_embeddings = len(weight)
    return larger


def larger_factory(
    factory: CoreTriplesFactory,
    triples: np.ndarray,
    entities: Vocabulary,
    relations: Vocabulary,
) -> CoreTriplesFactory:
    """A copy of a factory with other triples, ids of shape (T, 3), and with more entities and
    relations.
    """
    options: dict[str, Any] = {"metadata": dict(factory.metadata)}
    options["create_inverse_triples"] = factory.create_inverse_triples
    mapped = torch.from_numpy(triples)
    if not isinstance(factory, TriplesFactory):
        return CoreTriplesFactory(mapped, entities.number, relations.number, **options)
    options |= {
        "mapped_triples": mapped,
        "relation_to_id": dict(relations.ids),
        "entity_to_id": dict(entities.ids),
    }
    if not isinstance(factory, TriplesNumericLiteralsFactory):
        return TriplesFactory(**options)
    old = factory.numeric_literals
    options["numeric_literals"] = np.pad(
        old, ((0, entities.number - len(old)), *[(0, 0)] * (old.ndim - 1))
    )
    return TriplesNumericLiteralsFactory(literals_to_id=factory.literals_to_id, **options)


def of_result(
    model: Any, factory: Any, triples: Any
) -> tuple[PykeenModel, CoreTriplesFactory, Any]:
    """Model, factory and triples of a call with them,
    or with the result of PyKEEN's pipeline and triples.
    """
    if not isinstance(model, PipelineResult):
        return unwrapped(model), factory, triples
    if triples is None:
        factory, triples = None, factory
    return unwrapped(model.model), model.training if factory is None else factory, triples


def vocabularies_of(
    model: PykeenModel, factory: CoreTriplesFactory
) -> tuple[Vocabulary, Vocabulary]:
    """Labels of entities and relations by id, if there are any;
    InputError if a factory does not fit its model.
    """
    with naming_argument("factory"):
        if not isinstance(factory, CoreTriplesFactory):
            raise InputError(
                "", "", f"expected a triples factory of PyKEEN's, got {short(factory)}"
            )
        expected = f"{model.num_entities} entities and {model.num_real_relations} relations"
        if (
            got := f"{factory.num_entities} entities and {factory.real_num_relations} relations"
        ) != expected:
            raise InputError("", "", f"expected {expected}, as the model has, got {got}")
        if not isinstance(factory, TriplesFactory):
            return (
                Vocabulary("entity", None, factory.num_entities),
                Vocabulary("relation", None, factory.real_num_relations),
            )
        if (number := len(set(factory.entity_to_id.values()))) != factory.num_entities:
            raise InputError(
                "", "", f"expected labels of all {factory.num_entities} entities, got {number}"
            )
    entities = Vocabulary("entity", names_by_id(factory.entity_to_id))
    return entities, Vocabulary("relation", names_by_id(factory.relation_to_id))


def labelled(triples: Any) -> np.ndarray | list[Any]:
    """The triples of a factory, as labels if it has labels;
    other forms as ``listed_triples`` gives them.
    """
    if isinstance(triples, CoreTriplesFactory):
        triples = triples.triples if isinstance(triples, TriplesFactory) else triples.mapped_triples
    return listed_triples(triples)


def _new_labels(
    rows: np.ndarray | list[Any], entities: Vocabulary, relations: Vocabulary, may_lack: bool
) -> list[str]:
    """Labels of entities in triples that the factory lacks, in order;
    InputError without any, unless they ``may_lack``.
    """
    if entities.names is None:
        raise InputError(
            "argument 'new'", "", "expected the number of new entities: the factory has no labels"
        )
    whole = [tuple(triple) for triple in rows if hasattr(triple, "__len__") and len(triple) == 3]
    ends = dict.fromkeys(
        str(end) for head, _, tail in whole for end in (head, tail) if isinstance(end, str)
    )
    new = [end for end in ends if end not in entities.ids]
    if new or may_lack:
        return new
    for row, (head, _, tail) in enumerate(whole):
        for end in (head, tail):
            if is_whole(end) and end >= entities.number:
                problem = f"expected labels, as the factory has, but no entity has the id {end}"
                remedy = f"labels in 'new' get the ids {entities.number}, ... in order"
                raise InputError("argument 'triples'", f"triple {row}", f"{problem}: {remedy}")
    known = triples_of(rows, "triples", entities, relations)
    names = ", ".join(
        repr(entities.of(row)) for row in dict.fromkeys(known[:, [HEAD, TAIL]].flatten().tolist())
    )
    problem = "there are no triples"
    if len(known):
        problem = f"all are known already: {names}; {FURTHER_FACTS}"
    raise InputError("argument 'triples'", "", f"expected a label of a new entity, but {problem}")
