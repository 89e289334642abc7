"""``isi.insert``: vectors for new entities in a trained embedding."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import torch

from isi.errors import InputError
from isi.graph.graph import HEAD, TAIL
from isi.initializers.api import InitResult, NoRelationMap
from isi.initializers.scale import Scale
from isi.insertion import engine
from isi.insertion.arguments import Embedder, TripleForms, naming_argument, options_by_name
from isi.insertion.engine import Method, NovelEntities
from isi.insertion.hidden import HoldOut
from isi.insertion.request import Checked, InsertRequest, KnownEmbedding, checked_request, refusal
from isi.insertion.result import Details, Inserted
from isi.insertion.selection import Selection, named, one_score, preferred, select
from isi.models.losses import Loss, TrainingLoss, loss_named
from isi.models.model import Model
from isi.models.stack import Embedding, NotFinite, usual_torch


def insert(
    entities: np.ndarray | torch.Tensor,
    relations: np.ndarray | torch.Tensor,
    triples: TripleForms,
    *,
    new: int | Sequence[str],
    model: str | Model,
    model_options: Mapping[str, Any] | None = None,
    entity_names: Sequence[str] | None = None,
    relation_names: Sequence[str] | None = None,
    known_triples: TripleForms | None = None,
    words: Any = None,
    kinds: Any = None,
    initializer: str | None = None,
    options: Mapping[str, Any] | None = None,
    trained_with: Loss | TrainingLoss | None = None,
    harm: float = 0.01,
    choose: bool = True,
    validation: TripleForms | None = None,
    seed: int = 0,
    new_relations: int | Sequence[str] = 0,
    embedder: Embedder | None = None,
    confidence: Sequence[float] | np.ndarray | None = None,
) -> Inserted:
    """Compute vectors for new entities from their triples, words or kinds. Known vectors do not
    change.

    New entities have the ids E, E + 1, ... in the order of ``new``, new relations R, R + 1, ....
    New entities that have triples with each other are inserted ``ROUNDS`` times: first those with
    known entities, then those next to them, then all.

    Args:
        entities: vectors of the known entities, shape (E, d); if complex, the real half, then the
            imaginary half. Tensors may need gradients; bfloat16 becomes float32.
        relations: vectors of the relations, shape (R, w), with w = ``Model.width(d)``.
        triples: of new entities and relations; this argument, ``new``, ``words``, ``kinds``, and
            all from ``seed`` on are fields of ``InsertRequest``, where their forms are listed.
        model: scoring function: analogy, distmult, complex, transe, transe_l1 (L1 norm), rotate, or
            your own ``Model`` (set ``invertible = False`` if its ``transform`` or ``inverse`` only
            raises an error).
        model_options: ``margin`` and (not ``transe_l1``) ``squared`` of a distance model;
            ``constraint`` of entity vectors: none, sphere (length 1) or ball (length at most 1), if
            the embedding was trained with it; ignored with a ``Model``.
        entity_names: names of the E known entities; ``relation_names``: names of the R relations.
        known_triples: triples of known entities, for ``interference`` and the default initializer.
            If given, similar entities are among their ends.
        initializer: a name (docs/initializers.md), with ``options`` that replace its own. None: the
            best for hidden known entities (``choose``), or with ``choose=False`` the preferred one.
        trained_with: the loss of training: logistic, softmax, margin, self-adversarial, or a
            ``TrainingLoss``. None: unknown.
        harm: how much the MRR of earlier triples may fall: the dial between use and harm.
        validation: triples of known entities that were not trained on: harm is measured on them.

    Returns:
        an ``Inserted``: the new ``vectors``, (n, d), and both tables, (E + n, d) and (R + q, w);
        its method ``report`` describes each new entity.

    Raises:
        InputError: names the wrong argument or new entity, and the expected value.
        TypeError: names an argument that there is not.

    Warns:
        UserWarning: the selected initializer harms earlier triples, or the model ranks its own
            triples almost at random.

    Example:
        >>> import isi, numpy as np
        >>> entities = np.array([[1.0, 0.0], [0.0, 1.0]])  # cup, bed
        >>> relations = np.array([[1.0, 1.0]])  # near
        >>> names = {"entity_names": ["cup", "bed"], "relation_names": ["near"]}
        >>> facts = {"mug": {"near": ["cup"]}}
        >>> how = {"model": "distmult", "initializer": "er_avg"}
        >>> done = isi.insert(entities, relations, facts, new=["mug"], **names, **how)
        >>> done.vectors.tolist()
        [[1.0, 0.0]]
        >>> done.entity_names, done.entities.shape
        (['cup', 'bed', 'mug'], (3, 2))
    """
    known = KnownEmbedding(
        entities, relations, model, model_options, entity_names, relation_names, known_triples
    )
    request = InsertRequest(
        triples=triples,
        new=new,
        words=words,
        kinds=kinds,
        initializer=initializer,
        options=options,
        trained_with=trained_with,
        harm=harm,
        choose=choose,
        validation=validation,
        seed=seed,
        new_relations=new_relations,
        embedder=embedder,
        confidence=confidence,
    )
    return insert_request(known, request, stacklevel=4)


@usual_torch()
def insert_request(known: KnownEmbedding, request: InsertRequest, stacklevel: int = 2) -> Inserted:
    """Insert new entities and relations: check the request, select the initializer, compute rows.

    ``stacklevel``: of warnings, 2 for the caller of this function.
    """
    checked = checked_request(known, request)
    method, test, selection = _method(checked, request)
    for sentence in selection.warnings if selection else ():
        warnings.warn(sentence, stacklevel=stacklevel + 1)  # the decorator is a frame, too
    test = replace(test, loss=method.trained_with)
    # the copy of the table in which the engine works ends with this function
    working = checked.with_rows()
    scale = Scale(loss_named(method.trained_with))
    if method.initializer.cost == "newton" or working.novel.has_new_relations:
        scale = test.scales[0]
    working = replace(working, novel=replace(working.novel, scale=scale))
    computed = run_engine(working.novel, method, working.name_of)
    details = Details(*working.new_rows(method), checked, method, test, computed)
    return Inserted(details, selection)


def _method(checked: Checked, request: InsertRequest) -> tuple[Method, HoldOut, Selection | None]:
    """The initializer of a request, the hold-out test of the embedding, and the selection if there
    was one. Without a selection the test still serves: the scale of scores is fitted on it, and
    probabilities are, where a caller asks for them.
    """
    novel, model = checked.novel, checked.model
    options = options_by_name(request.options, "options")
    has_triples = bool(novel.has_one_novel_end.any())
    entities = novel.known + novel.number
    if request.initializer is not None:
        method = named(request.initializer, options, model, entities)
    else:
        default = preferred(model, has_triples, novel.words_serve, request.trained_with)
        method = named(default.initializer.name, options, model, entities)
        method = replace(method, why=default.why)
    method = replace(method, trained_with=request.trained_with or "logistic")
    # a model without inverse cannot serve a new entity that has triples alone by an initializer
    # that needs words
    words_for_all = novel.words_serve and (model.invertible or bool(novel.has_words.all()))
    test = _hold_out(checked, words_for_all, request.trained_with)
    is_free = request.initializer is None and not options
    if request.choose and is_free and len(novel.known_triples) and novel.number:
        method, selection = select(test, has_triples, words_for_all, harm=request.harm)
        return method, test, selection
    return method, test, None


def _hold_out(checked: Checked, with_words: bool, loss: Loss | TrainingLoss | None) -> HoldOut:
    """The hold-out test of the known entities, with as many insert triples as new ones have."""
    novel = checked.novel
    known, theta = novel.known, novel.theta
    insert_triples = novel.triples[novel.has_one_novel_end]
    new_ends = insert_triples[:, [HEAD, TAIL]].max(1) - known
    return HoldOut(
        Embedding(
            theta.entity[:, :known],
            theta.relation[:, : novel.known_relations],
            one_score(theta.model),
        ),
        novel.known_triples,
        np.bincount(new_ends, minlength=novel.number),
        novel.words[:known] if with_words and novel.words is not None else None,
        None if novel.kinds is None else novel.kinds[:known],
        novel.seed,
        loss,
        checked.validation,
    )


def run_engine(
    novel: NovelEntities, method: Method, name_of: Callable[[int], str | int]
) -> InitResult | None:
    """Compute rows with the engine. Its errors name the argument or the new entity, by its place
    (``name_of``).
    """
    try:
        with naming_argument("initializer"):
            return engine.insert(novel, method)
    except NoRelationMap as error:
        name = method.initializer.name
        expected = f"expected word vectors, also of known entities, for {name}"
        without = novel.has_triple & ~novel.has_words
        raise refusal(without, expected, name_of) from error
    except NotFinite as error:
        expected = f"expected other known vectors: {error.message}"
        raise InputError("argument 'entities'", "", expected) from error
