"""Import of a model that PyKEEN has pickled, as a bundle."""

from pathlib import Path

import torch

from isi.errors import InputError
from isi.live.bundle import Bundle
from isi.live.importer import OTHERS, Labels, bundle_of
from isi.models.model import name_of, stored_options
from isi.pykeen.reading import loss_of, read_model, unwrapped


def of_pickle(path: Path, labels: Labels) -> Bundle:
    """A bundle of a pickled model; InputError for another file,
    or if ``MODELS`` lacks the model.
    """
    try:
        # runs code: --trust-pickle allows it
        loaded = torch.load(path, map_location="cpu", weights_only=False)
    except Exception as error:  # a pickle can raise any error
        expected = f"expected a model of PyKEEN's ({type(error).__name__})"
        raise InputError(path, "", expected) from error
    pickled = unwrapped(loaded)
    read = read_model(pickled, torch.from_numpy(labels.triples), None)
    name = name_of(read.model)
    if not name or pickled.use_inverse_triples:
        expected = "expected TransE, DistMult, ComplEx or RotatE without inverse triples"
        raise InputError(path, "", f"{expected}: {OTHERS}")
    tables = [read.entity[0].numpy(), read.relation[0].numpy()]
    loss = loss_of(pickled, read.model)
    return bundle_of(name, stored_options(read.model), tables, labels, [path], loss)
