"""``insert``: a copy of a model of PyKEEN with new entities; ``compute_rows`` and ``enlarge``:
its two steps.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from typing import Annotated, Any, Unpack

import numpy as np
import torch
from pydantic import Field
from pykeen.pipeline import PipelineResult
from pykeen.triples import CoreTriplesFactory, TriplesFactory, TriplesNumericLiteralsFactory

from isi.config import check, is_whole
from isi.errors import InputError, short
from isi.graph.graph import HEAD, RELATION, TAIL
from isi.graph.vocabulary import Vocabulary, names_by_id
from isi.insertion.api import insert_request
from isi.insertion.arguments import (
    listed_triples,
    naming_argument,
    triples_of,
)
from isi.insertion.inverses import InverseRelations, pack
from isi.insertion.request import InsertRequest, KnownEmbedding, Settings
from isi.insertion.result import Inserted
from isi.models.model import Model
from isi.models.stack import usual_torch
from isi.pykeen import reading
from isi.pykeen.reading import (
    PykeenModel,
    copied,
    read_model,
    stored,
    tables_of,
    unwrapped,
)

#: What serves facts about entities that are known.
FURTHER_FACTS = (
    "isi.pykeen.fit_new trains the row of a known entity on further facts (new=[its label]); "
    "isi.from_pykeen observes, removes and inserts again"
)


def insert(
    model: PykeenModel | PipelineResult,
    factory: Any = None,
    triples: Any = None,
    *,
    new: int | Sequence[str] | None = None,
    words: Any = None,
    kinds: Any = None,
    margin: float | None = None,
    **settings: Unpack[Settings],
) -> tuple[PykeenModel, CoreTriplesFactory]:
    """Insert new entities or relations into a copy of a trained model:
    ``insert(model, factory, triples)``.

    Known vectors stay unchanged.

    To train the copy, use ``fit_new`` or ``train_on``: PyKEEN's own ``train`` starts again from
    random vectors.

    Args:
        model: stores the vectors of entities in tables, as most models do, perhaps within a wrapper
            of ``torch.compile`` or ``DataParallel``, which copies lack. DistMult and ComplEx work
            with all initializers, TransE (L1, L2, squared) and RotatE with all but ridge, others
            with those that need no inverse (map_mean, mean, es, ...). Or the result of PyKEEN's
            pipeline: ``insert(result, triples)``.
        factory: the triples factory that the model was trained on.
        triples: of the new entities and relations, as labels (if the factory has labels) or ids, in
            any form of ``isi.insert``; or another triples factory.
        new: labels of the new entities (None: all labels in ``triples`` that the factory lacks,
            with a warning if one is nearly a known label, and an error if it has no triple with a
            known entity, either); their number if the factory has no labels.
        words, kinds: see ``isi.insertion.request.InsertRequest``, with labels for names.
        margin: added to scores (except of DistMult and ComplEx), so that score 0 means probability
            ½; None: estimated from scores of the factory's triples and of corrupted ones.
        settings: the other fields of ``InsertRequest``. ``new_relations`` are labels, or their
            number if the factory has no labels; the model needs tables of relations, and triples
            of new relations may lie between known entities.

    Returns:
        copies of the model, with the vectors of new entities and relations as last rows, and of the
        factory, with their labels and triples. With inverse triples, a new relation has two rows,
        its own and that of its inverse. PyKEEN can predict with, evaluate and save them. Numeric
        literals of new entities are zero, as PyKEEN sets those of entities without literals.

    Raises:
        InputError: names the wrong argument or new entity, and the expected value.

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
    model, factory, triples = of_result(model, factory, triples)
    done = compute_rows(
        model,
        factory,
        triples,
        new=new,
        words=words,
        kinds=kinds,
        margin=margin,
        **settings,
    )
    return enlarge(model, factory, done)


@usual_torch()
def compute_rows(
    model: PykeenModel | PipelineResult,
    factory: Any = None,
    triples: Any = None,
    *,
    new: int | Sequence[str] | None = None,
    words: Any = None,
    kinds: Any = None,
    margin: float | None = None,
    **settings: Unpack[Settings],
) -> Inserted:
    """The result of ``isi.insert`` for the arguments of ``insert``:
    vectors, report and interference.

    With a model of inverse triples, each triple counts in both directions. In the result, as in
    PyKEEN's predictions, tails are scored by the relation and heads by its inverse; a row of
    ``relations`` joins both.

    Example:
        >>> rows = isi.pykeen.compute_rows(model, factory, [("mug", "in", "kitchen")])
        >>> rows.entities.shape, rows.entity_names[-1]
        ((5, 4), 'mug')
    """
    check(margin, Annotated[float, Field(allow_inf_nan=False)] | None, "", "argument 'margin'")  # type: ignore[arg-type]
    model, factory, triples = of_result(model, factory, triples)
    tables_of(model)
    known_entities, known_relations = vocabularies_of(model, factory)
    relations = known_relations.with_new(settings.get("new_relations", 0), "new_relations")
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
    joined = ids[(ids[:, [HEAD, TAIL]] < factory.num_entities).any(1)][:, [HEAD, TAIL]]
    for label, other in near.items():
        if not (joined == names.ids[label]).any():
            expected = f"expected a triple of the new entity {label!r} with a known one"
            problem = f"did you mean {other!r}, which is known? ('new' lists new ones)"
            raise InputError("argument 'triples'", "", f"{expected}: {problem}")
    embedding = read_model(model, factory.mapped_triples, margin)
    known = (ids[:, [HEAD, TAIL]] < factory.num_entities).all(1) & (
        ids[:, RELATION] < known_relations.number
    )
    for head, relation, tail in ids[known][:1].tolist():
        triple = f"({names.of(head)}, {relations.of(relation)}, {names.of(tail)})"[:200]
        raise InputError(
            "argument 'triples'",
            triple,
            f"expected a new entity or relation, but all are known already: {FURTHER_FACTS}",
        )
    embedding = pack(embedding) if model.use_inverse_triples else embedding
    try:
        known_embedding = KnownEmbedding(
            embedding.entity[0].numpy(),
            embedding.relation[0].numpy(),
            embedding.model,
            entity_names=known_entities.names,
            relation_names=known_relations.names,
            triples=factory.mapped_triples.numpy(),
            numbers_are_ids=True,
        )
        if settings.get("trained_with") is None:
            settings["trained_with"] = reading.loss_of(model, embedding.model)
        request = InsertRequest(triples=ids, new=new, words=words, kinds=kinds, **settings)
        done = insert_request(known_embedding, request, stacklevel=4)
    except InputError as error:
        if near and error.file.startswith("new entity"):
            label = next((label for label in near if repr(label) in error.file), next(iter(near)))
            raise InputError(
                error.file,
                error.place,
                f"{error.message}; for {label!r}, did you mean {near[label]!r}?",
            ) from error
        raise
    for label, other in near.items():
        warnings.warn(
            f"new entity {label!r}: did you mean {other!r}, which is known? ('new' lists new ones)",
            stacklevel=4,
        )
    return done


@usual_torch()
def enlarge(
    model: PykeenModel, factory: CoreTriplesFactory, done: Inserted
) -> tuple[PykeenModel, CoreTriplesFactory]:
    """Copies of a model and its factory, with the vectors,
    labels and triples of new entities and relations.

    Example:
        >>> rows = isi.pykeen.compute_rows(model, factory, [("mug", "in", "kitchen")])
        >>> larger, more = isi.pykeen.enlarge(model, factory, rows)
        >>> larger.num_entities, more.entity_to_id["mug"]
        (5, 4)
    """
    larger = add_rows(model, done.vectors, done.relations[done.new_relations], done.model)
    new = np.concatenate([done.insert_triples, done.between])
    triples = np.concatenate([factory.mapped_triples.numpy(), new])
    return larger, larger_factory(factory, triples, done.names, done.labels)


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
