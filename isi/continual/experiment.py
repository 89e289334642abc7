"""An experiment of the third pipeline: a timeline, and the chains that grow along it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from pydantic import Field

from isi.config import Count, Name, Names, Positive, Section, check_names, keywords
from isi.continual.chain import Growth
from isi.continual.classes import CLASS_MEAN
from isi.continual.matrix import HITS, PROTOCOLS, SQUARE
from isi.continual.strategies import STRATEGIES, Schedule
from isi.continual.timeline import BENCHMARKS, Timeline
from isi.errors import InputError, at, suggestion
from isi.graph.words import Words
from isi.initializers.api import INITIALIZERS, options_of
from isi.models.model import Model, make_model
from isi.tables.rules import FROM_0, FROM_1, NAME, SHARE, at_least, one_of
from isi.tables.table import Table, TensorFile
from isi.training.rows import Recipe

DEFAULT = "default"  #: In place of an initializer's name: the best by the hold-out test.
_CHAIN = {"initializer": NAME.optional, "strategy": NAME.optional, "seed": FROM_0}
#: R[i, j] in the columns of ``evaluate``, by chain. Rows without ``initializer`` and ``strategy``
#: are those of the first embedding of a seed, which all of its chains share.
MATRIX = Table(
    "data/continual/{experiment}/matrix.parquet",
    {
        **_CHAIN,
        "phase": one_of("inserted", "trained"),
        "protocol": one_of(*PROTOCOLS),
        "i": FROM_0,
        "j": FROM_0,
        "slot": one_of("head", "tail"),
        "answer": one_of("new", "old"),
        "queries": FROM_1,
        "mrr": SHARE,
        SQUARE: SHARE,
        **{f"hits@{k}": SHARE for k in HITS},
    },
    key=[*_CHAIN, "phase", "protocol", "i", "j", "slot", "answer"],
)
#: What each snapshot took: seconds of one processor without ranking, and the peak memory of the
#: process, MiB (null where the system does not tell). They differ from run to run.
COSTS = Table(
    "data/continual/{experiment}/costs.parquet",
    {
        **_CHAIN,
        "snapshot": FROM_0,
        "phase": one_of("inserted", "trained"),
        "seconds": at_least(0, "float64"),
        "peak_mib": at_least(0, "float64").optional,
    },
    key=[*_CHAIN, "snapshot", "phase"],
)
#: ``fault_shares`` of the timeline.
FAULTS = Table(
    "data/continual/{experiment}/faults.parquet",
    {
        "fault": NAME,
        "test": FROM_0,
        "queries": FROM_0,
        "share": SHARE.optional,
        "answers": at_least(0, "float64").optional,
    },
    key=["fault", "test"],
)

#: The first embedding of each seed: ``entity`` (M, E, d), ``relation`` (M, R, 2d).
FIRST = TensorFile("data/continual/{experiment}/first.safetensors")


class ChainTraining(Recipe):
    """``training`` in an entry of ``continual``: the recipe, and for how long."""

    base_epochs: Count  #: of the first snapshot, and of ``retrain``
    epochs: Count  #: of each later snapshot
    init_range: Positive  #: half the range of the first vectors

    @property
    def schedule(self) -> Schedule:
        return Schedule(self, self.base_epochs, self.epochs, self.init_range)


class ContinualExperiment(Section):
    """An entry of ``continual`` in the params of the third pipeline."""

    title: str
    timeline: str  #: a name in ``BENCHMARKS``, or a folder below ``data/raw`` as LKGE writes it
    words: Words | None = None  #: word vectors of the entities; null: initializers see none
    model: Name
    model_options: dict[str, Any] = Field(default_factory=dict)
    dimension: Count
    training: ChainTraining
    seeds: Count
    most_tests: Count | None  #: test triples of a snapshot that are ranked; null: all
    #: with options, of which ``initializer`` names another one than the key; ``default``: the
    #: chosen one
    initializers: dict[Name, dict[str, Any]]
    strategies: dict[Name, dict[str, Any]]  #: likewise, with ``strategy`` among the options
    #: which strategies follow which initializer
    pairs: Literal["all"] | dict[Name, Literal["all"] | Names]

    def read_timeline(self) -> Timeline:
        """The timeline; InputError for an unknown benchmark or a wrong file."""
        is_folder = Path(self.timeline).is_dir()
        return (Timeline.from_folder if is_folder else Timeline.benchmark)(self.timeline)

    def make_model(self, key: str) -> Model:
        return make_model(self.model, self.model_options, key)

    def strategies_of(self, initializer: str) -> list[str]:
        """The strategies that follow an initializer, in order."""
        listed = "all" if self.pairs == "all" else self.pairs.get(initializer, [])
        return list(self.strategies) if listed == "all" else listed

    def chains(self, experiment: str) -> list[Chain]:
        """All chains: by initializer, strategy and seed."""
        return [
            Chain(experiment, (seed,), initializer, strategy)
            for initializer in self.initializers
            for strategy in self.strategies_of(initializer)
            for seed in range(self.seeds)
        ]

    def first(self, experiment: str) -> list[Chain]:
        """The first embedding of each seed."""
        return [Chain(experiment, (seed,)) for seed in range(self.seeds)]

    def initializer_of(self, key: str) -> tuple[str, dict[str, Any]]:
        """The initializer and the options of a key of ``initializers``."""
        options = dict(self.initializers[key])
        return options.pop("initializer", key), options

    def strategy_of(self, key: str) -> tuple[str, dict[str, Any]]:
        """The strategy and the options of a key of ``strategies``."""
        options = dict(self.strategies[key])
        return options.pop("strategy", key), options

    def growth(self, chain: Chain) -> Growth:
        """How a chain grows."""
        assert chain.initializer and chain.strategy  # noqa: S101, PT018
        initializer, options = self.initializer_of(chain.initializer)
        strategy, strategy_options = self.strategy_of(chain.strategy)
        return Growth(
            initializer=None if initializer == DEFAULT else initializer,
            options=options,
            strategy=strategy,
            strategy_options=strategy_options,
            loss=self.training.loss,
        )


@dataclass(frozen=True)
class Chain:
    """One embedding that grows along the timeline of an experiment."""

    experiment: str
    seeds: Sequence[int]  #: its seed alone
    initializer: str | None = None  #: None: the first embedding, which other chains start from
    strategy: str | None = None

    @property
    def seed(self) -> int:
        return self.seeds[0]

    @property
    def first(self) -> Chain:
        """The first embedding of its seed."""
        return Chain(self.experiment, self.seeds)

    @property
    def columns(self) -> dict[str, Any]:
        """The columns of tables that name it."""
        return {"initializer": self.initializer, "strategy": self.strategy, "seed": self.seed}

    def __str__(self) -> str:
        names = [name for name in (self.initializer, self.strategy) if name]
        return ", ".join([self.experiment, *names, f"seed {self.seed}"])


def check_experiment(entry: ContinualExperiment, key: str) -> None:
    """InputError for an unknown name or a wrong option in an entry at ``key`` of params."""
    if entry.timeline not in BENCHMARKS and not Path(entry.timeline).is_dir():
        close = suggestion(entry.timeline, BENCHMARKS)
        expected = f"expected one of {', '.join(BENCHMARKS)}, or a folder{close}"
        raise InputError("", f"{key}.timeline", expected)
    with at("", f"{key}.dimension"):
        entry.make_model(f"{key}.model").width(entry.dimension)
    for name in entry.initializers:
        place = f"{key}.initializers.{name}"
        initializer, options = entry.initializer_of(name)
        if initializer not in (DEFAULT, CLASS_MEAN):
            defaults = INITIALIZERS.get(initializer, place).defaults
            options_of(initializer, {**defaults, **options}, place)
        elif options:
            raise InputError("", place, "expected no options")
        if initializer == CLASS_MEAN and entry.timeline not in BENCHMARKS:
            expected = f"expected another initializer than {CLASS_MEAN}: a folder has no classes"
            raise InputError("", place, expected)
    for name in entry.strategies:
        strategy, options = entry.strategy_of(name)
        check_names([strategy], STRATEGIES, f"{key}.strategies")
        keywords(STRATEGIES[strategy], options, f"{key}.strategies.{name}")
    for name in entry.pairs if entry.pairs != "all" else ():
        check_names([name], entry.initializers, f"{key}.pairs")
        for strategy in entry.strategies_of(name):
            check_names([strategy], entry.strategies, f"{key}.pairs.{name}")
