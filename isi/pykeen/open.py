"""``isi.from_pykeen``: a home of a PyKEEN model."""

import warnings
from collections.abc import Mapping
from typing import Any

import numpy as np
from pykeen.pipeline import PipelineResult
from pykeen.triples import CoreTriplesFactory, TriplesFactory

from isi.errors import InputError
from isi.graph.graph import RELATION
from isi.home.bundle import Manifest, stored_loss
from isi.home.database import Database
from isi.home.home import Home
from isi.home.loaded import LoadedEmbedding
from isi.initializers.inverses import pack
from isi.models.losses import Loss, TrainingLoss
from isi.models.model import Model, name_of, stored_options
from isi.models.stack import usual_torch
from isi.names import plain
from isi.pykeen.insertion import add_rows, larger_factory, of_result, vocabularies_of
from isi.pykeen.reading import PykeenModel, loss_of, read_model
from isi.vocabulary import by_known_name, note_of_kinds


class PykeenHome(Home):
    """A home that was made from a model of PyKEEN, and gives one back after any change.

    Example:
        >>> home = isi.from_pykeen(model, factory)
        >>> effect = home.tell({"mug": {"in": "kitchen"}})
        >>> home.model.num_entities, home.factory.entity_to_id["mug"]
        (5, 4)
        >>> effect = home.undo()
        >>> home.model.num_entities
        4
    """

    def __init__(
        self,
        bundle: LoadedEmbedding,
        model: PykeenModel,
        factory: CoreTriplesFactory,
        database: Database | None = None,
    ) -> None:
        """Use ``isi.from_pykeen``."""
        super().__init__(bundle, database)
        self._trained = model, factory
        self._made_from: LoadedEmbedding | None = None

    @property
    def model(self) -> PykeenModel:
        """A copy of the model with the inserted entities as last rows; the same one until the next
        change.
        """
        return self._enlarged[0]

    @property
    def factory(self) -> CoreTriplesFactory:
        """A copy of the triples factory, with the inserted entities and all facts that hold, except
        those of new relations, which the model does not have.
        """
        return self._enlarged[1]

    @property
    @usual_torch()
    def _enlarged(self) -> tuple[PykeenModel, CoreTriplesFactory]:
        now, known = self.now, len(self.base.entities)
        if self._made_from is not now:
            model, factory = self._trained
            trained = factory.mapped_triples.numpy()
            is_retracted = np.isin(now.keys_of(trained), now.keys_of(now.retracted))
            added = now.triples[len(now.triples) - now.added :]
            added = added[added[:, RELATION] < len(self.base.relations)]
            triples = np.concatenate([trained[~is_retracted], added])
            no_relations = now.relations[:0]
            larger = add_rows(model, now.entities[known:], no_relations, now.model)
            self._current = larger, larger_factory(factory, triples, now.names, self.base.labels)
            self._made_from = now
        return self._current


@usual_torch()
def from_pykeen(
    model: PykeenModel | PipelineResult,
    factory: TriplesFactory | None = None,
    *,
    kinds: Mapping[str, str] | None = None,
    margin: float | None = None,
) -> PykeenHome:
    """A home of a trained model of PyKEEN, or of the result of its pipeline.
    The model is not changed. ``model`` and ``factory`` of the home have all that was
    inserted.

    DistMult, ComplEx, TransE and RotatE without inverse triples can be saved into a folder.

    Args:
        factory: the triples factory with labels that the model was trained on; not with a result of
            the pipeline.
        kinds: kinds of entities by label, which leave unfitting answers out. Warns of labels that
            match no entity, and of entities without a kind.
        margin: of a distance model; None: estimated (``isi.pykeen.insert``).

    Raises:
        InputError: the model has no tables of entities, or the factory no labels.

    Example:
        >>> home = isi.from_pykeen(model, factory)
        >>> home.tell({"mug": {"in": "kitchen"}}).inserted
        ['mug']
    """
    model, known, _ = of_result(model, factory, ())
    names, labels = vocabularies_of(model, known)
    entities, relations = names.names, labels.names
    if entities is None or relations is None:
        raise InputError("argument 'factory'", "", "expected a triples factory with labels")
    read = read_model(model, known.mapped_triples, margin)
    read = pack(read) if model.use_inverse_triples else read
    can_be_stored = getattr(read.model, "margin", 1.0) > 0
    name = name_of(read.model) if can_be_stored else None
    triples = np.unique(known.mapped_triples.numpy(), axis=0)
    kind_of, missing = by_known_name(kinds or {}, names)
    without = [label for label in entities if kinds and label not in kind_of]
    if note := note_of_kinds(missing, len(kinds or {}), without, names):
        warnings.warn(f"kinds: {note}", stacklevel=3)
    loaded = LoadedEmbedding(
        _manifest(read.model, name, loss_of(model, read.model)),
        read.entity[0].numpy(),
        read.relation[0].numpy(),
        entities,
        [kind_of.get(label, "") for label in entities],
        list(map(plain, entities)),
        relations,
        triples,
        scoring=None if name else read.model,
    )
    return PykeenHome(loaded, model, known)


def _manifest(model: Model, name: str | None, loss: Loss | TrainingLoss | None) -> Manifest:
    """What a folder says of a model; ``name``: None if a folder cannot hold it."""
    options: dict[str, Any] = stored_options(model) if name else {}
    return Manifest(
        model_name=name or "pykeen",
        model_options=options,
        words=None,
        trained_with=stored_loss(loss),
        made={},
    )
