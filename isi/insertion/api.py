"""``isi.insert``: vectors for new entities in a trained embedding."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import torch
from torch import Tensor

from isi.config import NotNegative, Seed, check
from isi.errors import InputError
from isi.graph.graph import HEAD, RELATION, TAIL
from isi.initializers import api as initializers
from isi.initializers.api import INITIALIZERS, InitContext, InitResult, NoRelationMap, Registered
from isi.insertion import arguments
from isi.insertion.arguments import Names, Source, TripleForms, argument, stack_of_one, table
from isi.insertion.choice import HIDDEN, Choice, calibrated, hide
from isi.insertion.inverses import BothWays, adapted
from isi.insertion.relations import fit_relations
from isi.insertion.result import Inserted
from isi.insertion.rounds import schedule
from isi.models.model import Model
from isi.models.stack import Embedding, NotFinite, without_denormals

#: Candidates for the default initializer, the best first (compared in docs/method.md). The default
#: is the first one whose data are given and that supports the model.
BEST = ("map", "soft_es", "mean")
#: Maximum number of elements: word similarities of entity pairs; one batch of new entities; weights
#: of a result.
PAIRS, BUDGET, MOST_WEIGHTS = 2**29, 2**24, 2**24
FEW = 32  #: Number of triples up to which all new entities share batches.
MARGIN_TRIPLES = 1000  #: Maximum number of triples from which a margin is estimated.


@without_denormals()
def insert(
    entities: np.ndarray | torch.Tensor,
    relations: np.ndarray | torch.Tensor,
    triples: TripleForms,
    *,
    new: int | Sequence[str],
    model: str | Model,
    model_options: Mapping[str, Any] | None = None,
    new_relations: int | Sequence[str] = 0,
    entity_names: Sequence[str] | None = None,
    relation_names: Sequence[str] | None = None,
    known_triples: TripleForms | None = None,
    words: Any = None,
    word_source: Source | None = None,
    kinds: Any = None,
    initializer: str | None = None,
    options: Mapping[str, Any] | None = None,
    seed: int = 0,
    calibrate: bool = True,
    tolerance: float = 0.02,
    budget: float = 3,
) -> Inserted:
    """Compute vectors for new entities from their triples, words or kinds.
    Known vectors do not change.

    Args:
        entities: vectors of the known entities, shape (E, d); if complex, the real half, then the
            imaginary half. Tensors may need gradients; bfloat16 becomes float32.
        relations: vectors of the relations, shape (R, w), with w = ``Model.width(d)``.
        triples: (head, relation, tail) by names or ids, each with a new entity or relation, in a
            list, an array, a tensor or a DataFrame; or facts by head and relation,
            ``{"smart pill": {"isa": ["medical_device"]}}``. New entities have the ids E, E + 1, ...
            in the order of ``new``, new relations R, R + 1, .... New entities that have triples
            with each other are inserted ``ROUNDS`` times: first those with known entities, then
            those next to them, then all.
        new: names of the new entities; without ``entity_names``, their number n.
        model: scoring function: analogy, distmult, complex, transe, transe_l1 (L1 norm), rotate, or
            your own ``Model`` (set ``invertible = False`` if its ``transform`` or ``inverse`` only
            raises an error).
        new_relations: names of new relations in ``triples``; without ``relation_names``, their
            number q. Their rows minimize MAP's objective, too (``fit_relations``).
        model_options: ``margin`` and (not ``transe_l1``) ``squared`` of a distance model; ignored
            with a ``Model``.
        entity_names: names of the E known entities; ``relation_names``: names of the R relations.
        known_triples: triples of known entities, for ``interference`` and the default initializer.
            If given, similar entities are among their ends.
        words: word vectors of known and new entities, shape (E + n, v), zero if missing; or a
            mapping from names or ids to vectors or texts.
        word_source: embeds the texts in ``words``: a function, gensim's ``KeyedVectors``, or a file
            of word vectors.
        kinds: a kind for each of the E + n entities; or a mapping from names or ids to kinds. Means
            and priors are of known entities of a new one's kind. No kind: an empty text, None, or,
            in an array of numbers, -1.
        initializer: a name; None: the best by calibration. ``options`` replace its default options.
        seed: root seed of random initializers and of the hidden entities.
        calibrate: without a named initializer and ``options``, hide known entities, insert them
            from as many of their triples as the new ones have, and choose the initializer with the
            highest MRR about them among those that keep the MRR of earlier triples
            (``Inserted.choice``). If false, or with too few ``known_triples``: the first of
            ``BEST`` for the given data.
        tolerance: largest loss of the MRR of earlier triples, if a tenth more entities
            (or all new ones) were inserted.
        budget: seconds of one core for the choice, by an estimate of its work; a clock would change
            results.

    Returns:
        an ``Inserted``: both tables, (E + n, d) and (R + q, w); its method ``report`` describes
            each new entity.

    Raises:
        InputError: names the wrong argument or new entity, and the expected value.

    Warns:
        UserWarning: the chosen initializer harms earlier triples, or the model ranks its own
            triples almost at random.
    """
    check(seed, Seed, "", "argument 'seed'")
    for name, value in (("tolerance", tolerance), ("budget", budget)):
        check(value, NotNegative, "", f"argument {name!r}")
    rows = table(entities, "entities")
    known, names = (
        len(rows),
        arguments.all_names(Names("entity_names", len(rows), entity_names), new, "new"),
    )
    rows = np.concatenate([rows, np.zeros((names.number - known, rows.shape[1]), rows.dtype)])
    given = arguments.checked_arguments(
        rows,
        relations,
        model,
        model_options,
        names,
        relation_names,
        known,
        triples,
        known_triples,
        new_relations,
    )
    new_ids, old_relations = np.arange(known, len(rows)), len(relations)
    if not len(new_ids) and len(given.relations) == old_relations:
        raise InputError("argument 'new'", "", "expected at least one new entity")
    vectors, kind_ids = (
        arguments.word_table(words, word_source, names),
        arguments.kinds_of(kinds, names),
    )
    one_new_end = (given.triples[:, [HEAD, TAIL]] >= known).sum(1) == 1
    insert_triples = given.triples[one_new_end]
    has_triple = np.isin(
        new_ids, given.triples[given.triples[:, HEAD] != given.triples[:, TAIL]][:, [HEAD, TAIL]]
    )
    has_words = np.zeros_like(has_triple) if vectors is None else vectors[known:].any(1)
    words_serve = vectors is not None and bool(vectors[:known].any() and has_words.any())

    def refusal(entities: np.ndarray, expected: str) -> InputError:
        return InputError(
            f"new entity {names.of(known + int(np.argmax(entities)))!r:.80}", "", expected
        )

    if initializer is None and (bare := ~(has_triple | (has_words & words_serve))).any():
        expected = (
            "expected insert triples, word vectors (also of known entities), "
            "or an initializer such as mean"
        )
        raise refusal(bare, expected)
    theta0 = stack_of_one(rows, given.relations, given.model)
    choice, has_triples = None, len(insert_triples) > 0
    chosen, used, why, together = choose(initializer, options, theta0, has_triples, words_serve)
    # a model without inverse cannot serve a new entity that has triples alone by an initializer
    # that needs words
    words_for_all = words_serve and (given.model.invertible or bool(has_words.all()))
    hidden_from = (
        Embedding(
            theta0.entity[:, :known], theta0.relation[:, :old_relations], one_score(given.model)
        ),
        given.known_triples,
        np.bincount(insert_triples[:, [HEAD, TAIL]].max(1) - known, minlength=len(rows) - known),
        vectors[:known] if words_for_all and vectors is not None else None,
        None if kind_ids is None else kind_ids[:known],
        seed,
    )
    if (
        calibrate
        and initializer is None
        and not options
        and len(given.known_triples)
        and len(new_ids)
    ):
        best, used, why, choice = default(
            has_triples, words_for_all, *hidden_from, tolerance=tolerance, budget=budget
        )
        chosen, used, _, together = choose(best, used, theta0, has_triples, words_serve)
        for sentence in choice.warnings if choice else ():
            warnings.warn(sentence, stacklevel=3)
    name = chosen.name

    def initialized(ids: np.ndarray, seen: np.ndarray) -> list[InitResult]:
        parts = batches(torch.from_numpy(ids), seen, together, max(given.relations.shape))
        given_to = (
            init_context_of(theta0, part, known, seen, given.known_triples, vectors, kind_ids, seed)
            for part in parts
        )
        with argument("initializer"):
            results = [chosen.initialize(context, used) for context in given_to]
        return results if len(parts) < 2 else [in_order_of_ids(results, torch.cat(parts))]

    try:
        results = in_rounds(
            theta0, known, old_relations, given.triples, given.known_triples, initialized
        )
    except NoRelationMap as error:
        raise refusal(
            has_triple & ~has_words, f"expected word vectors, also of known entities, for {name}"
        ) from error
    except NotFinite as error:
        raise InputError(
            "argument 'entities'", "", f"expected other known vectors: {error.message}"
        ) from error
    with np.errstate(over="ignore"):
        rows[known:] = theta0.entity[0, known:].numpy()
        given.relations[old_relations:] = theta0.relation[0, old_relations:].numpy()
    if not (np.isfinite(rows[known:]).all() and np.isfinite(given.relations).all()):
        expected = f"expected smaller numbers: {name} computes NaN or infinity from them"
        raise InputError("argument 'entities'", "", expected)
    weights = [
        result.weights[0, :, :known].float() for result in results if result.weights is not None
    ]
    few = 0 < len(weights) == len(results) and (names.number - known) * known <= MOST_WEIGHTS
    masks = [result.indicators[0] for result in results if result.indicators is not None]
    return Inserted(
        entities=rows,
        relations=given.relations,
        model=given.model,
        entity_names=names.names,
        relation_names=given.relation_names.names,
        new=new_ids.tolist(),
        new_relations=list(range(old_relations, len(given.relations))),
        insert_triples=insert_triples,
        between=given.triples[~one_new_end],
        known_triples=given.known_triples,
        initializer=name,
        options=used,
        why=why,
        choice=choice,
        hide=partial(hide, *hidden_from, HIDDEN if choice is None else choice.most_hidden),
        fallback=[
            initializers.FALLBACKS[code]
            for result in results
            for code in result.fallback[0].tolist()
        ],
        weights=torch.cat(weights).numpy() if few else None,
        indicators=[row.nonzero()[:, 0].tolist() for mask in masks for row in mask]
        if masks
        else None,
    )


def in_rounds(
    theta0: Embedding,
    known: int,
    old_relations: int,
    triples: np.ndarray,
    known_triples: np.ndarray,
    initialized: Callable[[np.ndarray, np.ndarray], list[InitResult]],
) -> list[InitResult]:
    """Write the rows of new entities and relations into ``theta0``; the results of the last round.

    A new relation is fitted before each round to its triples between entities that have vectors.
    Until it has a row, its triples are not used.
    """
    usable = triples[:, RELATION] < old_relations
    has_vector = np.arange(theta0.entity.shape[1]) < known
    repeat = bool((~usable & ~has_vector[triples[:, [HEAD, TAIL]]].all(1)).any())

    def fit() -> None:
        if theta0.relation.shape[1] > old_relations:
            ready = triples[has_vector[triples[:, [HEAD, TAIL]]].all(1)]
            usable[np.isin(triples[:, RELATION], ready[:, RELATION])] = True
            theta0.relation[0, old_relations:] = fit_relations(
                theta0,
                known,
                old_relations,
                torch.from_numpy(ready),
                torch.from_numpy(known_triples),
            )

    results = list[InitResult]()
    for ids, seen in schedule(triples, known, theta0.entity.shape[1] - known, repeat):
        fit()
        results = initialized(ids, triples[seen & usable])
        if results:
            theta0.entity[0, ids] = torch.cat([result.vectors[0] for result in results])
        has_vector[ids] = True
    if repeat:
        fit()
    return results


def choose(
    initializer: Any, options: Any, theta0: Embedding, triples: bool, words: bool
) -> tuple[Registered, dict[str, Any], str, int]:
    """The named or default initializer, its options, the reason for the choice,
    the number of new entities per batch.

    ``triples`` and ``words``: whether any can be used. ``InputError`` if the initializer or an
    option is unknown, the embedding is too large for it, or the model does not support it.
    """
    given = arguments.options_by_name(options, "options")
    why, (_, entities, dimension) = "as named", theta0.entity.shape
    check(initializer, str | None, "", "argument 'initializer'")  # type: ignore[arg-type]
    with argument("initializer"):
        if initializer is None:
            initializer, why = best(theta0, triples, words)
        registered = INITIALIZERS.get(initializer, "initializer")
        checked = initializers.options_of(
            initializer, {**registered.defaults, **given}, "initializer"
        )
        registered.check(theta0.model)
        if too_large(registered, entities):
            work = f"which compares the words of every two of {entities:,} entities: choose another"
            raise InputError("", "", f"the embedding is too large for {initializer}, {work}")
    numbers = max(entities, theta0.relation.shape[1] * dimension)  # for one new entity
    return adapted(registered, theta0.model), checked, why, max(1, BUDGET // numbers)


def too_large(registered: Registered, entities: int) -> bool:
    return registered.cost == "pairs" and entities**2 > PAIRS


def fitting(theta0: Embedding, triples: bool, words: bool) -> list[Registered]:
    """The registered initializers that support the model and need no more than the given data."""
    lacking = {name for name, there in (("words", words), ("insert_triples", triples)) if not there}
    every = [INITIALIZERS.get(name, name) for name in INITIALIZERS.names()]
    fit = (
        each for each in every if not lacking & set(each.needs) and not each.misses(theta0.model)
    )
    return [adapted(each, theta0.model) for each in fit]


def one_score(model: Model) -> Model:
    """The model, with heads scored by the relation and not by its inverse:
    ``calibrated`` has one score per triple.
    """
    return replace(model, heads_by_inverse=False) if isinstance(model, BothWays) else model


def best(theta0: Embedding, triples: bool, words: bool) -> tuple[str, str]:
    """The first of ``BEST`` for the given data, and the reason for it."""
    names = {each.name for each in fitting(theta0, triples, words)}
    why = "the best for " + " and ".join(["words"] * words + ["triples"] * triples)
    return next(name for name in BEST if name in names), why


def default(
    triples: bool,
    words: bool,
    theta0: Embedding,
    known_triples: np.ndarray,
    numbers: np.ndarray,
    vectors: np.ndarray | None,
    kinds: np.ndarray | None,
    seed: int,
    *,
    tolerance: float,
    budget: float,
) -> tuple[str, dict[str, Any], str, Choice | None]:
    """The default initializer, its options, the reason,
    and the comparison (``calibrated``) if there can be one.

    ``BEST``, optima of an objective and own initializers are compared: on hidden known entities,
    means of a few known vectors seem to harm less than they do (docs/insert.md). ``triples``,
    ``words``: whether new entities have any.
    """
    name, why = best(theta0, triples, words)
    fit = {each.name: each for each in fitting(theta0, triples, words)}
    listed = [
        each
        for each in fit.values()
        if each.cost == "newton" or each.role == "own" or each.name in BEST
    ]
    listed = [
        each for each in listed if each.name != name and not too_large(each, theta0.entity.shape[1])
    ]
    choice = calibrated(
        [fit[name], *listed],
        theta0,
        known_triples,
        numbers,
        vectors,
        kinds,
        seed,
        tolerance,
        budget,
    )
    if choice is None:
        return name, dict(fit[name].defaults), why, None
    return choice.chosen.initializer, dict(choice.chosen.options), choice.why, choice


def margin_of(embedding: Embedding, triples: Tensor, margin: float | None) -> float:
    """The given margin; None: −(mean score of triples, (T, 3), + mean of corrupted ones) / 2;
    0 if linear or T = 0.
    """
    if margin is not None or embedding.model.linear or not len(triples):
        return margin or 0.0
    head, relation, tail = triples[:: -(-len(triples) // MARGIN_TRIPLES)].T[:, None]
    with torch.no_grad():
        right = embedding.score(head, relation, tail).mean()
        other_heads = embedding.score(head.roll(1, 1), relation, tail).mean()
        other_tails = embedding.score(head, relation, tail.roll(1, 1)).mean()
    return -(right / 2 + (other_heads + other_tails) / 4).item()


def batches(new: Tensor, triples: np.ndarray, together: int, width: int) -> list[Tensor]:
    """Ids of new entities, (n,), in batches of at most ``together``,
    each padded to its largest number of triples.

    Entities of a batch have at most ``FEW`` triples, or numbers that differ by a factor of two at
    most. Vectors of length ``width`` for all triples of a batch, padding included, have at most
    ``BUDGET`` numbers, or it is one entity.
    """
    ends = torch.from_numpy(triples[:, [HEAD, TAIL]].copy(order="C")).flatten()
    number = torch.bincount(ends, minlength=int(new.max()) + 1)[new] if len(new) else new
    level = (number / FEW).clamp(min=1).log2().ceil().long()
    parts = list[Tensor]()
    for step in sorted(set(level.tolist())):
        most = max(1, min(together, BUDGET // (FEW * 2**step * width)))
        parts += torch.split(new[level == step], most)
    return parts


def in_order_of_ids(results: list[InitResult], ids: Tensor) -> InitResult:
    """The results of batches as one, by ascending id; ``ids``: of all batches, (n,)."""
    order = torch.argsort(ids)
    vectors, fallback = (
        torch.cat([getattr(result, name) for result in results], 1)[:, order]
        for name in ("vectors", "fallback")
    )
    weights = [result.weights for result in results if result.weights is not None]
    together = torch.cat(weights, 1)[:, order] if len(weights) == len(results) else None
    return InitResult(vectors, fallback, together, results[0].is_centroid)


def init_context_of(
    theta0: Embedding,
    new: Tensor,
    known: int,
    insert_triples: np.ndarray,
    known_triples: np.ndarray,
    words: np.ndarray | None,
    kinds: np.ndarray | None,
    seed: int,
) -> InitContext:
    """The data that an initializer gets for new entities;
    their ids ``new``, (n,), ascend and are ≥ ``known``.

    Other new entities may have vectors; they are no candidates.

    Shapes: triples (I, 3), (K, 3); words (N, v), kinds (N,) for all N entities. If K = 0, all known
    ones are eligible.
    """
    session = arguments.trained_session(known_triples, theta0, kinds)
    session.entities[:, known:] = False
    ends = torch.from_numpy(insert_triples[:, [HEAD, TAIL]].copy(order="C"))
    place = torch.searchsorted(new, ends).clamp(max=len(new) - 1)
    triple, end = (new[place] == ends).nonzero(as_tuple=True)
    order = torch.argsort(place[triple, end], stable=True)
    triple, end = triple[order], end[order]
    triples = torch.stack([torch.zeros_like(triple), place[triple, end], triple], 1)
    vectors = (
        torch.zeros(len(session.graph.entities), 1) if words is None else torch.from_numpy(words)
    )
    listed, keys = torch.from_numpy(insert_triples), new[None, :1] - known
    context = initializers.context_of(
        theta0, session, new[None], triples, vectors, seed, keys, listed
    )
    eligible = context.eligible if len(known_triples) else context.known
    return replace(context, eligible=eligible, by_kind=kinds is not None)
