"""``insert``: a copy of a model of PyKEEN with new entities; ``inserted`` and ``enlarge``: its two steps."""

import warnings
from collections.abc import Collection, Iterable, Mapping, Sequence
from copy import deepcopy
from dataclasses import replace
from typing import Annotated, Any

import numpy as np
import torch
from pydantic import Field
from pykeen.pipeline import PipelineResult
from pykeen.triples import CoreTriplesFactory, TriplesFactory, TriplesNumericLiteralsFactory

from isi.config import check
from isi.errors import InputError, short
from isi.graph.graph import HEAD, RELATION, TAIL
from isi.insertion import api
from isi.insertion.arguments import Names, Source, all_names, argument, listed_triples, triples_of
from isi.insertion.result import Inserted
from isi.pykeen.reading import BothWays, PykeenModel, both_ways, constrained, read_model, stored, tables_of

SHORTEST = 4  #: Minimum length of a new label that is compared with known ones.


def insert(
    model: PykeenModel | PipelineResult, factory: Any = None, triples: Any = None, *,
    new: int | Sequence[str] | None = None, words: Any = None, word_source: Source | None = None, kinds: Any = None,
    initializer: str | None = None, options: Mapping[str, Any] | None = None, margin: float | None = None,
    seed: int = 0, calibrate: bool = True, tolerance: float = 0.02, budget: float = 3,
) -> tuple[PykeenModel, CoreTriplesFactory]:  # fmt: skip
    """Insert new entities into a copy of a trained model: ``insert(model, factory, triples)``. Known vectors stay.

    To train the copy, use ``fit_new`` or ``train_on``: PyKEEN's own ``train`` starts again from random vectors.

    Args:
        model: stores the vectors of entities in tables, as most models do. DistMult and ComplEx work with all
            initializers, TransE (L1, L2, squared) and RotatE with all but ridge, others with those that need no inverse
            (map_mean, mean, es, ...). Or the result of PyKEEN's pipeline: ``insert(result, triples)``.
        factory: the triples factory that the model was trained on.
        triples: of the new entities, as labels (if the factory has labels) or ids: (head, relation, tail) in a list, an
            array or a tensor; a DataFrame with columns head, relation and tail, or three columns; another triples
            factory; or facts by head and relation, ``{"smart pill": {"isa": ["medical_device"]}}``.
        new: labels of the new entities (null: all labels in ``triples`` that the factory lacks, with a warning if one
            is nearly a known label); their number if the factory has no labels.
        words: vectors or texts by label, or word vectors of known and new entities; shape (E + n, v), zero if missing.
        word_source: embeds texts: a function, gensim's ``KeyedVectors``, or a file of word vectors.
        kinds: the kind of each entity, by label or in order.
        initializer: a name; null: chosen as by ``isi.insert``, which documents ``calibrate``, ``tolerance`` and
            ``budget``. ``options`` replace its default options.
        margin: added to scores (except of DistMult and ComplEx), so that score 0 means probability ½; null: estimated
            from scores of the factory's triples and of corrupted ones.
        seed: root seed of random initializers.

    Returns:
        copies of the model, with the vectors of new entities as last rows, and of the factory, with their labels and
        triples. PyKEEN can predict with, evaluate and save them. Numeric literals of new entities are zero, as PyKEEN
        sets those of entities without literals.

    Raises:
        InputError: names the wrong argument or new entity, and the expected value.
    """
    model, factory, triples = of_result(model, factory, triples)
    done = inserted(
        model, factory, triples, new=new, words=words, word_source=word_source, kinds=kinds, initializer=initializer,
        options=options, margin=margin, seed=seed, calibrate=calibrate, tolerance=tolerance, budget=budget,
    )  # fmt: skip
    return enlarge(model, factory, done)


def inserted(
    model: PykeenModel | PipelineResult, factory: Any = None, triples: Any = None, *,
    new: int | Sequence[str] | None = None, words: Any = None, word_source: Source | None = None, kinds: Any = None,
    initializer: str | None = None, options: Mapping[str, Any] | None = None, margin: float | None = None,
    seed: int = 0, calibrate: bool = True, tolerance: float = 0.02, budget: float = 3,
) -> Inserted:  # fmt: skip
    """The result of ``isi.insert`` for the arguments of ``insert``: vectors, report and interference.

    With a model of inverse triples, each triple is inserted in both directions. In the result, as in PyKEEN's
    predictions, tails are scored by the relation and heads by its inverse; a row of ``relations`` joins both.
    """
    check(margin, Annotated[float, Field(allow_inf_nan=False)] | None, "", "argument 'margin'")  # type: ignore[arg-type]
    model, factory, triples = of_result(model, factory, triples)
    tables_of(model)
    entity_labels, relation_labels = checked_labels(model, factory)
    relations = Names("relation_names", model.num_real_relations, relation_labels)
    with argument("triples"):
        rows = labelled(triples)
    near = {}
    if new is None:
        new = _new_labels(rows, factory, Names("entity_names", factory.num_entities, entity_labels), relations)
        near = nearly_known(new, factory.entity_to_id)
    names = all_names(Names("entity_names", factory.num_entities, entity_labels), new, "new")
    ids, known = torch.from_numpy(triples_of(rows, "triples", names, relations)), factory.mapped_triples
    embedding = read_model(model, known, margin)
    for head, relation, tail in ids[(ids[:, [HEAD, TAIL]] < factory.num_entities).all(1)][:1].tolist():
        triple = f"({names.of(head)}, {relations.of(relation)}, {names.of(tail)})"[:200]
        raise InputError("argument 'triples'", triple, "expected a new entity, but both are known already")
    if model.use_inverse_triples:
        ids, known = (both_ways(listed, relations.number) for listed in (ids, known))
        relation_labels = relation_labels and [*relation_labels, *(f"{label} (inverse)" for label in relation_labels)]
    try:
        done = api.insert(
            embedding.entity[0].numpy(), embedding.relation[0].numpy(), ids.numpy(), new=new, model=embedding.model,
            entity_names=entity_labels, relation_names=relation_labels, known_triples=known.numpy(), words=words,
            word_source=word_source, kinds=kinds, initializer=initializer, options=options, seed=seed,
            calibrate=calibrate, tolerance=tolerance, budget=budget,
        )  # fmt: skip
    except InputError as error:
        if near and error.file.startswith("new entity"):
            label = next((label for label in near if repr(label) in error.file), next(iter(near)))
            raise InputError(
                error.file, error.place, f"{error.message}; for {label!r}, did you mean {near[label]!r}?"
            ) from error
        raise
    for label, other in near.items():
        warnings.warn(
            f"new entity {label!r}: did you mean {other!r}, which is known? ('new' lists new ones)", stacklevel=3
        )
    vectors = constrained(model, torch.from_numpy(done.entities[done.known :])).numpy()
    done = replace(done, entities=np.concatenate([done.entities[: done.known], vectors]))
    return both_ways_joined(done, relations) if model.use_inverse_triples else done


def both_ways_joined(done: Inserted, relations: Names) -> Inserted:
    """The result with R relations, from that with their inverses as further relations and each triple both ways."""
    names = ("insert_triples", "between", "known_triples")
    lists = {name: rows[rows[:, RELATION] < relations.number] for name in names for rows in [getattr(done, name)]}
    joined = np.concatenate(np.split(done.relations, 2), 1)
    return replace(done, relations=joined, relation_names=relations.names, model=BothWays(done.model), **lists)


def enlarge(model: PykeenModel, factory: CoreTriplesFactory, done: Inserted) -> tuple[PykeenModel, CoreTriplesFactory]:
    """Copies of a model and its factory, with the vectors, labels and triples of the new entities of ``done``."""
    larger = deepcopy(model)
    larger.num_entities = number = len(done.entities)
    for table, rows in stored(larger, torch.from_numpy(done.entities[done.known :])):
        weight = table._embeddings.weight
        weight.data, weight.grad = torch.cat([weight.data, rows]), None  # same Parameter: regularizers may refer to it
        table.max_id = table._embeddings.num_embeddings = number
    new = torch.from_numpy(np.concatenate([done.insert_triples, done.between]))
    triples = torch.cat([factory.mapped_triples, new])
    options: dict[str, Any] = {
        "create_inverse_triples": factory.create_inverse_triples, "metadata": dict(factory.metadata),
    }  # fmt: skip
    if not isinstance(factory, TriplesFactory):
        return larger, CoreTriplesFactory(triples, number, factory.real_num_relations, **options)
    options |= {
        "mapped_triples": triples, "relation_to_id": factory.relation_to_id,
        "entity_to_id": dict(factory.entity_to_id) | {str(done.names.of(row)): row for row in done.new},
    }  # fmt: skip
    if not isinstance(factory, TriplesNumericLiteralsFactory):
        return larger, TriplesFactory(**options)
    literals = np.concatenate([
        factory.numeric_literals, np.zeros((len(done.new), *factory.literal_shape), factory.numeric_literals.dtype)
    ])  # fmt: skip
    return larger, TriplesNumericLiteralsFactory(
        numeric_literals=literals, literals_to_id=factory.literals_to_id, **options
    )


def of_result(model: Any, factory: Any, triples: Any) -> tuple[PykeenModel, CoreTriplesFactory, Any]:
    """Model, factory and triples of a call with them, or with the result of PyKEEN's pipeline and triples."""
    if not isinstance(model, PipelineResult):
        return model, factory, triples
    if triples is None:
        factory, triples = None, factory
    return model.model, model.training if factory is None else factory, triples  # type: ignore[return-value]


def checked_labels(model: PykeenModel, factory: CoreTriplesFactory) -> tuple[list[str] | None, list[str] | None]:
    """Labels of entities and relations by id, null without labels; InputError if a factory does not fit its model."""
    with argument("factory"):
        if not isinstance(factory, CoreTriplesFactory):
            raise InputError("", "", f"expected a triples factory of PyKEEN's, got {short(factory)}")
        expected = f"{model.num_entities} entities and {model.num_real_relations} relations"
        if (got := f"{factory.num_entities} entities and {factory.real_num_relations} relations") != expected:
            raise InputError("", "", f"expected {expected}, as the model has, got {got}")
        if not isinstance(factory, TriplesFactory):
            return None, None
        if (number := len(set(factory.entity_to_id.values()))) != factory.num_entities:
            raise InputError("", "", f"expected labels of all {factory.num_entities} entities, got {number}")
    entities, relations = (sorted(ids, key=ids.__getitem__) for ids in (factory.entity_to_id, factory.relation_to_id))
    return entities, relations


def labelled(triples: Any) -> np.ndarray | list[Any]:
    """The triples of a factory, as labels if it has labels; other forms as ``listed_triples`` gives them."""
    if isinstance(triples, CoreTriplesFactory):
        triples = triples.triples if isinstance(triples, TriplesFactory) else triples.mapped_triples
    return listed_triples(triples)


def _new_labels(
    rows: np.ndarray | list[Any], factory: CoreTriplesFactory, entities: Names, relations: Names
) -> list[str]:
    """All labels in triples that the factory lacks, in order; InputError if there are none."""
    if not isinstance(factory, TriplesFactory):
        raise InputError("argument 'new'", "", "expected the number of new entities: the factory has no labels")
    whole = [tuple(triple) for triple in rows if hasattr(triple, "__len__") and len(triple) == 3]
    ends = dict.fromkeys(str(end) for head, _, tail in whole for end in (head, tail) if isinstance(end, str))
    if new := [end for end in ends if end not in entities.ids]:
        return new
    known = triples_of(rows, "triples", entities, relations)
    names = ", ".join(repr(entities.of(row)) for row in dict.fromkeys(known[:, [HEAD, TAIL]].flatten().tolist()))
    problem = f"all are known already: {names}" if len(known) else "there are no triples"
    raise InputError("argument 'triples'", "", f"expected a label of a new entity, but {problem}")


def nearly_known(new: Collection[str], known: Iterable[str]) -> dict[str, str]:
    """For new labels that a slip of the pen may have made of a known label, that label.

    They differ in case, blanks, hyphens and underscores, or in one letter (another, missing, added, or exchanged with
    its neighbour), but in no digit.
    """
    spellings = {form: label for label in new if len(label) >= SHORTEST for form in _spellings(label)}
    lengths = {length for form in spellings for length in (len(form) - 1, len(form), len(form) + 1)}
    near = dict[str, str]()
    for other in known:
        if len(_plain(other)) in lengths:
            for form in _spellings(other) & spellings.keys():
                label = spellings[form]
                if [c for c in label if c.isdigit()] == [c for c in other if c.isdigit()]:
                    near.setdefault(label, other)
    return near


def _plain(label: str) -> str:
    return label.casefold().translate({ord(mark): None for mark in " -_"})


def _spellings(label: str) -> set[str]:
    """A label without case and marks, and all texts that lack one of its characters."""
    plain = _plain(label)
    return {plain, *(plain[:place] + plain[place + 1 :] for place in range(len(plain)))}
