"""What is inserted into an embedding, and how: the arguments of ``isi.insert``, checked."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import torch

from isi.config import NotNegative, Seed, check
from isi.errors import InputError
from isi.insertion import arguments
from isi.insertion.arguments import Embedder, TripleForms, table, triples_of
from isi.insertion.engine import Method, NovelEntities
from isi.models.losses import Loss, TrainingLoss
from isi.models.model import Model
from isi.models.stack import Embedding
from isi.process import quiet
from isi.vocabulary import Vocabulary


@dataclass(frozen=True, kw_only=True, eq=False)
class InsertRequest:
    """New entities and relations, and how they are inserted."""

    #: (head, relation, tail) by names or ids, each with a new entity or relation, in a list, an
    #: array, a tensor or a DataFrame; or facts by head and relation,
    #: ``{"smart pill": {"isa": ["medical_device"]}}``
    triples: TripleForms
    new: int | Sequence[str]  #: names of the new entities; without ``entity_names``, their number n
    #: names of new relations in ``triples``; without ``relation_names``, their number q. Their rows
    #: minimize MAP's objective, too (``fit_relations``).
    new_relations: int | Sequence[str] = 0
    #: word vectors of known and new entities, shape (E + n, v), zero if missing; or a mapping from
    #: names or ids to vectors or texts
    words: Any = None
    #: embeds the texts in ``words``: a function from a list of texts to vectors
    embedder: Embedder | None = None
    #: a kind for each of the E + n entities; or a mapping from names or ids to kinds. Means and
    #: priors are of known entities of a new one's kind. No kind: an empty text, None, or, in an
    #: array of numbers, -1.
    kinds: Any = None
    #: the loss that the embedding was trained with, which says what its scores mean
    #: (``isi.initializers.scale``)
    trained_with: Loss | TrainingLoss | None = None
    initializer: str | None = None  #: a name; None: the best by the hold-out test
    options: Mapping[str, Any] | None = None  #: replace default options of the initializer
    #: root seed of random initializers and of the hidden entities. Calls with the same seed draw
    #: the same numbers: give each call its own seed.
    seed: int = 0
    #: for random initializers, a key for each new entity: its numbers then depend on the seed and
    #: its key alone, not on the other new entities; shape (n,), int64
    entity_keys: np.ndarray | None = None
    #: whether new entities may have neither triples nor words, also without a named initializer:
    #: their vector is the mean of the known ones
    allow_without_facts: bool = False
    #: how far each of ``triples``, which are all different, is believed, from 0 to 1: its weight in
    #: MAP's objective; None: fully; shape (T,)
    confidence: Sequence[float] | np.ndarray | None = None
    #: without a named initializer and ``options``, hide known entities, insert them from as many of
    #: their triples as the new ones have, and select the initializer with the highest MRR about
    #: them, less a price on what earlier triples lose (``Inserted.selection``). If false, or
    #: with too few known triples: the preferred one for the given data.
    choose: bool = True
    #: how much the MRR of earlier triples may fall: the dial between use and harm
    harm: float = 0.01
    #: triples of known entities that the embedding was not trained on, in the forms of ``triples``:
    #: the selection measures harm on them. None: on triples of training, which hides some of it.
    validation: TripleForms | None = None

    def __post_init__(self) -> None:
        check(self.trained_with, Loss | TrainingLoss | None, "", "argument 'trained_with'")  # type: ignore[arg-type]
        for name, kind in (("seed", Seed), ("harm", NotNegative)):
            number = check(getattr(self, name), kind, "", f"argument {name!r}")
            object.__setattr__(self, name, number)  # of Python's, not of NumPy's
        check(self.initializer, str | None, "", "argument 'initializer'")  # type: ignore[arg-type]


@dataclass(frozen=True, eq=False)
class KnownEmbedding:
    """A trained embedding in the forms that a caller of ``isi.insert`` may give."""

    entities: np.ndarray | torch.Tensor  #: shape: (E, d)
    relations: np.ndarray | torch.Tensor  #: shape: (R, w)
    model: str | Model
    model_options: Mapping[str, Any] | None = None
    entity_names: Sequence[str] | None = None
    relation_names: Sequence[str] | None = None
    triples: TripleForms | None = None  #: of known entities
    #: whether numbers in triples are ids, also where they are names of other rows
    numbers_are_ids: bool = False


@dataclass(frozen=True, eq=False)
class Checked:
    """A request whose arguments are arrays that fit each other."""

    entities: np.ndarray  #: of known entities, the caller's table; shape: (E, d)
    #: in the given precision; new rows are zero until they are computed; shape: (R + q, w)
    relations: np.ndarray
    names: Vocabulary  #: of all entities
    relation_names: Vocabulary
    novel: NovelEntities
    validation: np.ndarray  #: of known entities, not trained on; ids, shape: (V, 3)

    @property
    def model(self) -> Model:
        return self.novel.theta.model

    def with_rows(self) -> Checked:
        """The same with rows of zeros for new entities in a copy of the table of ``novel``."""
        theta = self.novel.theta
        added = theta.entity.new_zeros(1, self.novel.number, theta.entity.shape[2])
        larger = replace(theta, entity=torch.cat([theta.entity, added], 1))
        return replace(self, novel=replace(self.novel, theta=larger))

    def new_rows(self, method: Method) -> tuple[np.ndarray, np.ndarray]:
        """The rows of new entities, (n, d), and of all relations, (R + q, w), as the engine wrote
        them, in the precision of the caller's tables; InputError if they are not finite.
        """
        novel, relations = self.novel, self.relations.copy()
        with np.errstate(over="ignore"):
            vectors = novel.theta.entity[0, novel.known :].numpy().astype(self.entities.dtype)
            relations[novel.known_relations :] = novel.theta.relation[0, novel.known_relations :]
        if not (np.isfinite(vectors).all() and np.isfinite(relations).all()):
            name = method.initializer.name
            expected = f"expected smaller numbers: {name} computes NaN or infinity from them"
            raise InputError("argument 'entities'", "", expected)
        return vectors, relations

    def refuse_without_facts(self) -> None:
        """InputError for a new entity with neither triples nor words that serve."""
        novel = self.novel
        without = ~(novel.has_triple | (novel.has_words & novel.words_serve))
        if without.any():
            expected = (
                "expected insert triples, word vectors (also of known entities), "
                "or an initializer such as mean"
            )
            raise refusal(without, expected, self.name_of)

    def name_of(self, place: int) -> str | int:
        """The name of a new entity by its place among them."""
        return self.names.of(self.novel.known + place)


def refusal(entities: np.ndarray, expected: str, name_of: Callable[[int], str | int]) -> InputError:
    """The error of the first new entity of a mask, (n,), or of ``words`` if it has none."""
    if not entities.any():
        return InputError("argument 'words'", "", expected)
    return InputError(f"new entity {name_of(int(np.argmax(entities)))!r:.80}", "", expected)


def checked_request(known: KnownEmbedding, request: InsertRequest) -> Checked:
    """Check a request against an embedding. ``InputError`` names the argument.

    The table of ``novel`` has the rows of known entities only (``Checked.with_rows``).
    """
    rows = table(known.entities, "entities")
    number, dimension = rows.shape
    are_ids = known.numbers_are_ids
    known_names = Vocabulary("entity", known.entity_names, number, numbers_are_ids=are_ids)
    if request.new is None:
        raise InputError("argument 'new'", "", "expected names of new entities, or their number")
    names = known_names.with_new(request.new, "new")
    model = arguments.checked_model(known.model, known.model_options, dimension)
    relations = table(known.relations, "relations", model.width(dimension))
    old = len(relations)
    known_labels = Vocabulary("relation", known.relation_names, old, numbers_are_ids=are_ids)
    labels = known_labels.with_new(request.new_relations, "new_relations")
    added = np.zeros((labels.number - old, relations.shape[1]), relations.dtype)
    relations = np.concatenate([relations, added])
    triples = triples_of(request.triples, "triples", names, labels)
    known_triples = triples_of(_or_empty(known.triples), "known_triples", names, labels)
    _check_sides(triples, known_triples, (number, old, number), names, labels)
    if names.number == number and labels.number == old:
        raise InputError("argument 'new'", "", "expected at least one new entity")
    novel = NovelEntities(
        theta=stack_of_one(rows, relations, model),
        known=number,
        number=names.number - number,
        known_relations=old,
        triples=triples,
        known_triples=known_triples,
        words=arguments.word_table(request.words, request.embedder, names),
        kinds=arguments.kinds_of(request.kinds, names),
        seed=request.seed,
        entity_keys=request.entity_keys,
        confidence=_confidence(request.confidence, len(triples)),
    )
    held_out = triples_of(_or_empty(request.validation), "validation", known_names, known_labels)
    checked = Checked(rows, relations, names, labels, novel, held_out)
    if request.initializer is None and not request.allow_without_facts:
        checked.refuse_without_facts()
    return checked


def _or_empty(triples: TripleForms | None) -> TripleForms:
    return [] if triples is None else triples


def _check_sides(
    triples: np.ndarray,
    known_triples: np.ndarray,
    first_new: tuple[int, int, int],
    names: Vocabulary,
    labels: Vocabulary,
) -> None:
    """InputError for one of ``triples`` without an id from ``first_new`` on, those of head,
    relation and tail, or one of ``known_triples`` with such an id; both of shape (T, 3).
    """
    has_new, had_new = (triples >= first_new).any(1), (known_triples >= first_new).any(1)
    for name, ids, wrong, expected in (
        ("triples", triples, ~has_new, "a new entity or relation, else use 'known_triples'"),
        ("known_triples", known_triples, had_new, "known entities and relations only"),
    ):
        for head, relation, tail in ids[wrong][:1].tolist():
            triple = f"({names.of(head)}, {labels.of(relation)}, {names.of(tail)})"[:200]
            raise InputError(f"argument {name!r}", triple, f"expected {expected}")


def _confidence(values: Sequence[float] | np.ndarray | None, triples: int) -> np.ndarray | None:
    """The argument ``confidence`` as an array, (T,), float64; an ``InputError`` if it is none."""
    if values is None:
        return None
    confidence: np.ndarray = table([values], "confidence", dtype=np.float64)[0]
    if confidence.shape != (triples,) or not ((confidence > 0) & (confidence <= 1)).all():
        expected = f"expected a number above 0, at most 1, for each of {triples} different triples"
        raise InputError("argument 'confidence'", "", expected)
    return confidence


def stack_of_one(
    entities: np.ndarray | torch.Tensor, relations: np.ndarray, model: Model
) -> Embedding:
    """Tables, (E, d) or a tensor (1, E, d), and (R, w), as one float32 embedding.
    Float32 vectors are not copied.
    """
    # values that overflow are refused later; torch warns of a table that is read-only
    with np.errstate(over="ignore"), quiet:
        if isinstance(entities, np.ndarray):
            entities = torch.from_numpy(np.ascontiguousarray(entities, np.float32))[None]
    return Embedding(entities, torch.from_numpy(np.array(relations, np.float32))[None], model)
