"""``isi.from_pykeen``: a live embedding of a PyKEEN model."""

import warnings
from collections.abc import Mapping
from typing import Any

import numpy as np
from pykeen.pipeline import PipelineResult
from pykeen.triples import TriplesFactory

from isi.errors import InputError
from isi.insertion.inverses import pack
from isi.live.embedding import LiveEmbedding
from isi.live.folder import Manifest
from isi.live.loaded import LoadedEmbedding
from isi.live.names import by_known_name, note_of_kinds
from isi.models.model import name_of
from isi.names import plain
from isi.pykeen.insertion import checked_labels, of_result
from isi.pykeen.reading import PykeenModel, read_model


def from_pykeen(
    model: PykeenModel | PipelineResult,
    factory: TriplesFactory | None = None,
    *,
    kinds: Mapping[str, str] | None = None,
    margin: float | None = None,
) -> LiveEmbedding:
    """A live embedding of a trained model of PyKEEN, or of the result of its pipeline.
    The model is not changed.

    DistMult, ComplEx, TransE and RotatE without inverse triples can be saved into a folder.

    Args:
        factory: the triples factory with labels that the model was trained on; not with a result of
            the pipeline.
        kinds: kinds of entities by label, which leave unfitting answers out. Warns of labels that
            match no entity (``same_name``), and of entities without a kind.
        margin: of a distance model; None: estimated (``isi.pykeen.insert``).

    Raises:
        InputError: the model has no tables of entities, or the factory no labels.

    Example:
        >>> home = isi.from_pykeen(model, factory)
        >>> home.insert("mug", {"in": "kitchen"}).inserted
        ['mug']
    """
    model, known, _ = of_result(model, factory, ())
    entities, relations = checked_labels(model, known)
    if entities is None or relations is None:
        raise InputError("argument 'factory'", "", "expected a triples factory with labels")
    read = read_model(model, known.mapped_triples, margin)
    read = pack(read) if model.use_inverse_triples else read
    # as a folder can hold it
    name = name_of(read.model) if getattr(read.model, "margin", 1.0) > 0 else None
    options: dict[str, Any] = vars(read.model) if name else {}
    manifest = Manifest(
        model_name=name or "pykeen", model_options=options, words=None, made={}, inserted=[]
    )
    triples = np.unique(known.mapped_triples.numpy(), axis=0)
    kind_of, missing = by_known_name(kinds or {}, entities)
    without = [label for label in entities if kinds and label not in kind_of]
    if note := note_of_kinds(missing, len(kinds or {}), without, len(entities)):
        warnings.warn(f"kinds: {note}", stacklevel=2)
    return LiveEmbedding(
        LoadedEmbedding(
            manifest,
            read.entity[0].numpy(),
            read.relation[0].numpy(),
            entities,
            [kind_of.get(label, "") for label in entities],
            list(map(plain, entities)),
            relations,
            triples,
            None,
            None if name else read.model,
        )
    )
