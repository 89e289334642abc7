"""Forms in which a graph leaves, one module each: what files it makes of a graph and of predictions."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import pandas as pd

from isi.registry import Plugins


@dataclass(frozen=True)
class Outgoing:
    """What leaves. Names are text that prints."""

    experiment: str
    #: columns entity, kind, phrase
    entities: pd.DataFrame
    #: columns head, relation, tail, count
    triples: pd.DataFrame
    #: columns head, relation, tail, score, rank; without rows where none are asked for
    predictions: pd.DataFrame
    #: whether RDF, too, has kinds and phrases of entities: two triples more for each
    labels: bool = False


#: Gives what files hold, by their paths, from what leaves and the path that is asked for; null: such a file is to go.
Form = Callable[[Outgoing, Path], dict[Path, str | None]]

FORMS: Plugins[Form] = Plugins(__name__)


def form(name: str) -> Callable[[Form], Form]:
    """Register a function as the form of a name."""

    def register(make: Form) -> Form:
        FORMS.register(name, make)
        return make

    return register
