"""A trained embedding with its names."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np
from pydantic import AfterValidator, BaseModel, ConfigDict, Field

from isi.config import LARGEST, Name, Option
from isi.errors import InputError
from isi.names import check_text
from isi.vocabulary import Vocabulary

if TYPE_CHECKING:
    from isi.models.losses import Loss, TrainingLoss

MANIFEST = "embedding.json"  #: Of the plain files that ``isi import`` reads.
MODEL = "all-MiniLM-L6-v2"  #: The sentence model of the shipped word vectors, except ``glove``.
Fact = tuple[str, str, str]  #: Head, relation and tail by name.
Text = Annotated[str, AfterValidator(check_text)]


class Record(BaseModel):
    """Base of the objects that JSON of a bundle or of a home holds."""

    model_config = ConfigDict(
        extra="forbid",
        strict=True,
        frozen=True,
        allow_inf_nan=False,
        defer_build=True,  # as of ``Section``
    )


class WordSource(Record):
    """The source of word vectors, from which a new phrase gets a comparable vector."""

    source: Text  #: a file's absolute path, ``shipped``, or a description
    #: the embedded text: definition, phrase, wordnet (phrase and definition), glove (mean of words)
    text: Text
    #: the sentence model that made them; None if there was none or it is unknown
    model: Text | None
    sha256: Text | None = None  #: of the file; None: unknown


#: ``isi.models.losses.LOSSES``: that module takes a second to import, and many commands need none.
LossName = Literal["logistic", "softmax", "margin", "self-adversarial"]


class StoredLoss(Record):
    """The fields of ``isi.models.losses.TrainingLoss``."""

    name: LossName
    margin: float
    temperature: float


class Manifest(Record):
    """Description of an embedding: model, source of words, origin."""

    model_name: Name
    model_options: dict[str, Option]
    words: WordSource | None
    #: the loss that it was trained with; None: unknown
    trained_with: LossName | StoredLoss | None = "logistic"
    #: relations of which an entity has one fact as a head: telling another one moves it
    functional: list[Text] = Field(default_factory=list)
    #: of answers about trained entities: by the state of a query (``isi.home.answers.state_of``)
    #: the slope and offset of ``all`` relations and of each one, by id, as ``Curves.stored`` has
    #: them; None: of an embedding that was not trained here
    curves: dict[str, dict[str, list[float]]] | None = None
    #: the same of inserted entities
    inserted_curves: dict[str, dict[str, list[float]]] | None = None
    made: dict[str, Any]  #: how it was trained, or the files that it was imported from; free form

    @property
    def loss(self) -> Loss | TrainingLoss | None:
        """``trained_with`` as the library takes it."""
        if not isinstance(self.trained_with, StoredLoss):
            return self.trained_with
        from isi.models.losses import TrainingLoss

        return TrainingLoss(**self.trained_with.model_dump())


def stored_loss(loss: Loss | TrainingLoss | None) -> LossName | StoredLoss | None:
    """A loss of training as a manifest keeps it."""
    return loss if loss is None or isinstance(loss, str) else StoredLoss(**vars(loss))


@dataclass(frozen=True, eq=False)
class Bundle:
    """An embedding with names, kinds, phrases, word vectors and known triples of its entities."""

    manifest: Manifest
    entities: np.ndarray  #: float32 or float64; shape: (E, d)
    relations: np.ndarray  #: shape: (R, w)
    entity_names: list[str]
    kinds: list[str]  #: of each entity; empty text if unknown
    phrases: list[str]  #: the words of each entity's name, for its word vector
    relation_names: list[str]
    triples: np.ndarray  #: ids; shape: (T, 3), int64
    #: shape: (E, v), float32; zero rows if missing; None if all are missing
    words: np.ndarray | None = None
    counts: np.ndarray | None = None  #: of each triple; None: 1; shape: (T,), int64

    def named_triples(self) -> list[Fact]:
        """The known triples by name."""
        names, labels = self.entity_names, self.relation_names
        return [
            (names[head], labels[relation], names[tail])
            for head, relation, tail in self.triples.tolist()
        ]

    def sizes(self) -> dict[str, int]:
        """The sizes that ``embedding.json`` lists too."""
        return {
            "entities": len(self.entities),
            "relations": len(self.relations),
            "dimension": self.entities.shape[1],
            "triples": len(self.triples),
        }


def with_functional(bundle: Bundle, relations: Sequence[str]) -> Bundle:
    """A bundle with functional relations; an ``InputError`` refuses an unknown one."""
    known = Vocabulary("relation", bundle.relation_names)
    names = [known.queried(name, str) for name in relations]
    manifest = bundle.manifest.model_copy(update={"functional": list(dict.fromkeys(names))})
    return replace(bundle, manifest=manifest)


def check_numbers(table: np.ndarray, rows: int) -> None:
    """InputError unless a table is (rows, any) floats with |x| ≤ ``LARGEST``,
    so that float32 scores are finite.
    """
    if (
        table.ndim != 2
        or len(table) != rows
        or not table.size
        or table.dtype not in (np.float32, np.float64)
    ):
        raise InputError(
            "",
            "",
            f"expected float32 or float64 of shape ({rows}, any), got {table.dtype} {table.shape}",
        )
    largest = np.abs(table).max(1)
    if not (sound := largest <= LARGEST).all():  # false for NaN
        row = int(sound.argmin())
        raise InputError(
            "", f"row {row}", f"expected finite |x| up to {LARGEST:g}, got {largest[row]:.3g}"
        )
