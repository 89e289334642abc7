"""The study of entities hidden from PyKEEN's training: its params and its table."""

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field

from isi.config import Count, Fraction, Name, NotNegative, Positive, Section, check, check_names
from isi.errors import at
from isi.graph.words import Words
from isi.initializers.api import INITIALIZERS
from isi.models.losses import LOSSES
from isi.tables import paths
from isi.tables.rules import FROM_0, FROM_1, NAME, REAL, SHARE, one_of
from isi.tables.table import Table

#: ``method``: key of ``methods`` in ``hidden_in``, or nothing (before any insertion).
#: ``initializer``: that of ``isi.pykeen.insert``; null for methods without it. ``told``: maximum
#: number of insert triples per entity (null: all). ``asked``: the answer is the ``known`` or the
#: ``hidden`` end of a triple of a hidden entity, or (``earlier``) either end of a test triple of
#: known entities. All entities are candidates. ``entities``: number of hidden. ``trained_with``:
#: the loss of training by which ``isi.pykeen.insert`` understood the scores. ``estimated_loss``:
#: the loss of MRR of earlier triples that the selection of the default expects; null elsewhere.
HIDDEN_ENTITIES = Table(
    "data/beyond/hidden/{study}.parquet",
    {
        "method": NAME,
        "initializer": NAME.optional,
        "told": FROM_1.optional,
        "seed": FROM_0,
        "asked": one_of("known", "hidden", "earlier"),
        "entities": FROM_1,
        "queries": FROM_1,
        "mrr": SHARE,
        "hits_at_10": SHARE,
        "trained_with": one_of(*LOSSES).optional,
        "estimated_loss": REAL.optional,
    },
    key=["method", "initializer", "told", "seed", "asked"],
)


def seconds_path(study: str) -> Path:
    """Path of a JSON file in the folder of ``HIDDEN_ENTITIES``:
    mean CPU seconds of each method by ``told``.
    """
    return HIDDEN_ENTITIES.path(study=study).with_suffix(".seconds.json")


#: Bound of ``HiddenTraining.valid``: two such shares are held out.
MOST_VALID = 0.5


class HiddenTraining(Section):
    """``training`` in an entry of ``hidden``: the settings of PyKEEN's training."""

    rules = (
        (
            lambda training: (
                training.loop == "rows" or (training.negatives is None) == (training.loop == "lcwa")
            ),
            "expected negatives with the loop slcwa, and null with lcwa",
        ),
        (
            lambda training: training.valid < MOST_VALID,
            "expected valid below a half: a test set is as large",
        ),
    )
    model: Name  #: PyKEEN's name of a model, in lower case
    model_options: dict[str, Any] = Field(default_factory=dict)  #: no ``regularizer``: none
    loss: Name  #: PyKEEN's name of a loss
    loss_options: dict[str, float] = Field(default_factory=dict)
    dimension: Count
    batch_size: Count
    learning_rate: Positive
    optimizer: Literal["adam", "adagrad"] = "adam"
    #: PyKEEN's name of a training loop; slcwa: sampled negatives; lcwa: all entities as answers; or
    #: rows: ``isi.training.rows``, which trains the tables of PyKEEN's model by Adagrad, several
    #: times as fast on a large graph, for all of ``max_epochs``
    loop: Literal["slcwa", "lcwa", "rows"] = "slcwa"
    #: negative triples per positive triple; None with lcwa; with rows: see ``Recipe``
    negatives: Count | None
    n3: NotNegative = 0.0  #: with rows: see ``Recipe``
    inverse_triples: bool = False  #: whether heads are predicted by the inverse of a relation
    #: share of the known triples, the validation set of early stopping and of
    #: ``isi.pykeen.insert``; a test set of earlier triples is as large
    valid: Fraction
    max_epochs: Count
    frequency: Count  #: epochs between two evaluations
    patience: Count  #: evaluations without improvement before training stops


class Hidden(Section):
    """An entry of ``hidden`` in the params of the second pipeline:
    a graph, and which of its entities are hidden.
    """

    title: str  #: in the table of the documentation
    graph: Name
    #: where ``graph`` is: PyKEEN's datasets, the entries of ``graphs``, or a table in ``data/raw``
    source: Literal["pykeen", "graphs", "table"]
    words: Words | None  #: word vectors of the entities; None: the graph has none
    seeds: Count
    fraction: Fraction  #: share of the entities that is hidden
    #: minimum number of a hidden entity's triples with a known end
    fewest: Annotated[int, Field(ge=2)]
    #: share of those triples that become queries (rounded down, at least one triple)
    queries: Fraction
    #: per entity; null: all but the queries
    max_insert_triples: Annotated[list[Count | None], Field(min_length=1)]
    initializers: list[Name]  #: compared with the default initializer of ``isi.pykeen.insert``
    training: HiddenTraining
    epochs: Count  #: of training after insertion
    #: whether PyKEEN's training of all rows after insertion is compared, with all insert triples
    train_all_rows: bool = True
    #: whether training from scratch is compared: one training with the insert triples of all hidden
    #: entities
    retrain: bool = True


def study_of(studies: Mapping[str, dict[str, Any]], study: str) -> Hidden:
    """An entry of ``hidden``, checked; InputError names the wrong key of ``beyond/params.yaml``."""
    key = f"hidden.{study}"
    settings = check(studies[study], Hidden, key, paths.BEYOND_PARAMS)
    with at(paths.BEYOND_PARAMS):
        check_names(settings.initializers, INITIALIZERS.names(), f"{key}.initializers")
    return settings
