"""Graphs that grow: what each initializer and strategy gains and harms, beside published numbers,
and what the faults of published protocols touch.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pandas as pd

from isi import config
from isi.report.tables.data import BASELINE, Models, read
from isi.report.tables.estimates import ENDS, Line, Names, named, over_seeds, where
from isi.report.tables.forms import ANY_SIZE
from isi.report.tables.registry import Frames, table

if TYPE_CHECKING:
    from isi.continual.experiment import ContinualExperiment

#: Names of strategies and faults, and published numbers with their sources.
PUBLISHED = config.read(Path(__file__).with_name("published.yaml"))
#: In place of an initializer's name: the best by the hold-out test.
DEFAULT = "default"
CHAIN = ["initializer", "strategy"]  #: Columns that name chains of several seeds.
Chain = tuple[str, str]  #: Keys of an initializer and a strategy in params.
RUN = [*CHAIN, "seed"]  #: Columns that name one chain.
#: Measures of ``GrownRuns.measures`` with their headers.
MEASURES = {
    "inserted": "new tests, at once",
    "trained": "new tests, after training",
    "base_before": "base test, before",
    "base": "base test, in the end",
    "interference": "D",
}
#: Further headers of ``GrownRuns.all_measures``.
AFTER_ALL = "new tests, after all"
SECONDS = "seconds"
NORMAL = 1.96  #: The 97.5 % quantile of a normal distribution.


def pooled(rows: pd.DataFrame, by: Names, measure: str = "mrr") -> pd.Series:
    """A measure over all queries that agree in the columns ``by``."""
    weighted = rows.assign(total=rows[measure] * rows["queries"])
    sums = weighted.groupby(list(by))[["total", "queries"]].sum()
    return sums["total"] / sums["queries"]


def _by_update(rows: pd.DataFrame) -> pd.Series:
    """MRR of each chain: the mean over pairs of an update and a slot."""
    means: pd.Series = pooled(rows, [*RUN, "i", "slot"]).groupby(level=RUN).mean()
    return means


def sample_variance(rows: pd.DataFrame) -> pd.Series:
    """The variance of the pooled MRR of each chain by the sample of its test triples.

    The unit is the triple, whose head and tail queries depend on each other; each test set is a
    sample of its own.
    """
    sets = [*RUN, "i", "j"]
    mean, square = (pooled(rows, sets, name) for name in ("mrr", "mrr_square"))
    queries = rows.groupby(sets)["queries"].sum()
    spread = 2 * queries * (square - mean**2).clip(lower=0)  # a triple has two queries
    sums: pd.Series = spread.groupby(level=RUN).sum() / queries.groupby(level=RUN).sum() ** 2
    return sums


def _title(name: str, is_plain: bool, options: Mapping[str, Any]) -> str:
    """A name with its options, where it stands for more than itself."""
    changed = [] if is_plain else [f"{option} {value}" for option, value in options.items()]
    return ", ".join([name, *changed])


@dataclass(frozen=True, eq=False)
class GrownRuns:
    """The chains of one experiment: R[i, j], the test set of snapshot j after snapshot i."""

    name: str  #: its key in params
    settings: "ContinualExperiment | Any"
    models: Models
    matrix: pd.DataFrame  #: all chains of a seed share the rows of the first embedding
    costs: pd.DataFrame
    faults: pd.DataFrame

    @property
    def chains(self) -> pd.MultiIndex:
        """Initializers with strategies, in the order of params."""
        settings = self.settings
        chains = [
            (initializer, strategy)
            for initializer in settings.initializers
            for strategy in settings.strategies_of(initializer)
        ]
        return pd.MultiIndex.from_tuples(chains, names=CHAIN)

    @cached_property
    def rows(self) -> pd.DataFrame:
        """The rows of every chain, those of the first embedding included."""
        parts, first = list[pd.DataFrame](), where(self.matrix, i=0)
        for initializer, strategy in self.chains:
            names = {"initializer": initializer, "strategy": strategy}
            parts += [first.assign(**names), where(self.matrix, **names)]
        return pd.concat(parts)

    def names(self, chain: Chain) -> dict[str, str]:
        """The display names of the initializer and of the strategy of a chain."""
        (initializer, options), (strategy, chosen) = self.parts(chain)
        labels = {**self.models.labels, **PUBLISHED["initializers"], DEFAULT: DEFAULT}
        return {
            "initializer": _title(labels[initializer], chain[0] == initializer, options),
            "strategy": _title(
                PUBLISHED["strategies"].get(strategy, strategy), chain[1] == strategy, chosen
            ),
        }

    def parts(self, chain: Chain) -> tuple[tuple[str, Line], tuple[str, Line]]:
        """The initializer of a chain, or the choice among them, and its strategy; with options."""
        return self.settings.initializer_of(chain[0]), self.settings.strategy_of(chain[1])

    def over_seeds(self, values: Mapping[str, pd.Series], scale: float = 100) -> pd.DataFrame:
        """Means of values by chain and seed, with intervals over seeds; rows are ``chains``."""
        frame = pd.DataFrame(values).rename_axis(RUN).reset_index()
        means = over_seeds(frame, CHAIN, {name: name for name in values}, scale)
        return means.reindex(self.chains)

    def over_tests(self, tests: Mapping[str, pd.DataFrame]) -> pd.DataFrame:
        """MRR (points) over the queries of rows by chain and seed, with intervals that include the
        error of the sample of test triples, which all seeds rank.

        The variance is that of the mean over seeds, plus the mean over seeds of the sample's: the
        second is at least what the sample adds to the mean.
        """
        means = self.over_seeds({name: pooled(rows, RUN) for name, rows in tests.items()})
        for name, rows in tests.items():
            variance = sample_variance(rows).groupby(level=CHAIN).mean().reindex(self.chains)
            mean, seeds = means[name], means[f"{name} high"] - means[name]
            around = (seeds**2 + (100 * NORMAL) ** 2 * variance) ** 0.5
            means[f"{name} low"], means[f"{name} high"] = mean - around, mean + around
        return means

    @cached_property
    def trained(self) -> pd.DataFrame:
        """The rows after training on each snapshot, under the protocol ``current``."""
        return where(self.rows, protocol="current", phase="trained")

    def historical(self, protocol: str) -> pd.Series:
        """MEOR's H_old (protocol ``old``) or H_cur (``current``) of each chain: the MRR of all
        earlier test sets, the mean over updates and slots.
        """
        earlier = self.rows[self.rows["j"] < self.rows["i"]]
        return _by_update(where(earlier, protocol=protocol, phase="trained"))

    @property
    def measures(self) -> pd.DataFrame:
        """``MEASURES`` in points, and seconds, by chain."""
        names = [*MEASURES.values(), SECONDS]
        return self.all_measures[[f"{name}{end}" for name in names for end in ENDS]]

    @cached_property
    def all_measures(self) -> pd.DataFrame:
        """``measures``, and the MRR of all later test sets in the end.

        The intervals of D and of seconds are over seeds alone.
        """
        current, last = where(self.rows, protocol="current"), self.rows["i"].max()
        new = current[(current["i"] == current["j"]) & (current["i"] > 0)]
        base = where(self.trained, j=0)
        later = where(self.trained, i=last)
        tests = {
            MEASURES["inserted"]: where(new, phase="inserted"),
            MEASURES["trained"]: where(new, phase="trained"),
            MEASURES["base_before"]: where(base, i=0),
            MEASURES["base"]: where(base, i=last),
            AFTER_ALL: later[later["j"] > 0],
        }
        interference = self.historical("old") - self.historical("current")
        seconds = self.costs.groupby(RUN)["seconds"].sum()
        parts = [
            self.over_tests(tests),
            self.over_seeds({MEASURES["interference"]: interference}),
            self.over_seeds({SECONDS: seconds}, scale=1),
        ]
        return pd.concat(parts, axis=1)

    def after_last(self, protocol: str, measures: Names) -> pd.DataFrame:
        """Means of measures over all test sets after the last snapshot, points."""
        rows = where(self.rows, protocol=protocol, phase="trained", i=self.rows["i"].max())
        sets = {name: pooled(rows, [*RUN, "j"], name) for name in measures}
        means = {name: values.groupby(level=RUN).mean() for name, values in sets.items()}
        return self.over_seeds(means)

    def interference(self, _protocol: str, measures: Names) -> pd.DataFrame:
        """MEOR's H_cur, H_old, D and A_TN after training, points."""
        h_cur, h_old = self.historical("current"), self.historical("old")
        rows = self.trained
        is_new = (rows["j"] == rows["i"]) & (rows["i"] > 0) & (rows["answer"] == "new")
        a_tn = _by_update(rows[is_new])
        values = {"H_cur": h_cur, "H_old": h_old, "D": h_old - h_cur, "A_TN": a_tn}
        return self.over_seeds({name: values[name] for name in measures})


def read_runs(experiments: Mapping[str, "ContinualExperiment"], models: Models) -> list[GrownRuns]:
    """The experiments that were run."""
    listed = list[GrownRuns]()
    for name, settings in experiments.items():
        folder = Path("data/continual", name)
        if (folder / "faults.parquet").exists():
            files = ("matrix", "costs", "faults")
            tables = [read(folder / f"{file}.parquet") for file in files]
            listed.append(GrownRuns(name, settings, models, *tables))
    return listed


#: Columns of ``carried``: title, chain and measure.
CARRIED = [
    ("new tests: class mean", ("class_mean", "insert"), MEASURES["inserted"]),
    ("new tests: ERAvg", ("er_avg", "insert"), MEASURES["inserted"]),
    ("new tests: soft RS", ("soft_rs", "insert"), MEASURES["inserted"]),
    ("new tests: default", (DEFAULT, "insert"), MEASURES["inserted"]),
    ("new tests: soft RS, new rows trained", ("soft_rs", "new_rows"), MEASURES["trained"]),
    ("base test: before", (DEFAULT, "insert"), MEASURES["base_before"]),
    ("base test: soft RS", ("soft_rs", "insert"), MEASURES["base"]),
    ("base test: default", (DEFAULT, "insert"), MEASURES["base"]),
    ("base test: soft RS, new rows trained", ("soft_rs", "new_rows"), MEASURES["base"]),
    ("base test: soft RS, all rows trained", ("soft_rs", "finetune"), MEASURES["base"]),
    ("base test: Xavier, all rows trained", (BASELINE, "finetune"), MEASURES["base"]),
    ("seconds: default", (DEFAULT, "insert"), SECONDS),
    ("seconds: soft RS, new rows trained", ("soft_rs", "new_rows"), SECONDS),
]


@table("continual")
def carried(results: Sequence[GrownRuns]) -> pd.DataFrame:
    """For each experiment with the default: what it gains right after insertion and what it costs,
    beside simple initializers, and training of new rows and of all rows on new facts alone.
    """
    rows = list[Line]()
    for runs in results:
        if (DEFAULT, "insert") not in runs.chains:
            continue
        row: Line = {"benchmark": runs.settings.title}
        for title, chain, measure in CARRIED:
            if chain in runs.chains:
                row |= named(runs.measures.loc[chain], measure, title)
        rows.append(row)
    frame = pd.DataFrame(rows)
    columns = ["benchmark", *(f"{title}{end}" for title, _, _ in CARRIED for end in ENDS)]
    return frame[[name for name in columns if name in frame]]


#: Lines of ``frontier``: by initializer and strategy, the title and the option that varies.
DIALS = {
    ("fold_in", "insert"): ("Fold-in, share", "share"),
    ("soft_rs", "replay"): ("Soft RS, replay", "number"),
    ("soft_rs", "l2"): ("Soft RS, drawn back", "weight"),
}
#: The line of a point, and the value of the option that varies, if it has one.
Place = tuple[str, Any]
#: Points of ``frontier``: initializers without training.
POINTS = (DEFAULT, "class_mean", "er_avg", "soft_rs")
#: Strategies of ``equal_time``, after soft RS.
TIMED = ("new_rows", "new_rows_and_earlier", "replay")


@table("continual")
def frontier(results: Sequence[GrownRuns]) -> pd.DataFrame:
    """Use against harm: the test sets of later snapshots in the end, and that of the first one."""
    points = _points(results, _dial)
    points.attrs[ANY_SIZE] = ["value"]
    return points


def _dial(runs: GrownRuns, chain: Chain) -> Place | None:
    (initializer, options), (strategy, chosen) = runs.parts(chain)
    line, option = DIALS.get((initializer, strategy), ("", ""))
    values = {**options, **chosen}
    if option in values and "epochs" not in values:
        return line, values[option]
    if strategy == "insert" and initializer in POINTS:
        return runs.names(chain)["initializer"], None
    return None


@table("continual")
def equal_time(results: Sequence[GrownRuns]) -> pd.DataFrame:
    """What training of new rows and of all rows gives for the seconds that it takes."""
    return _points(results, _epochs)


def _epochs(runs: GrownRuns, chain: Chain) -> Place | None:
    _, (strategy, chosen) = runs.parts(chain)
    varies = chain[1] == strategy or "epochs" in chosen
    if chain[0] != "soft_rs" or strategy not in TIMED or not varies:
        return None
    epochs = chosen.get("epochs", runs.settings.training.epochs)
    return runs.names((chain[0], strategy))["strategy"], epochs


def _points(
    results: Sequence[GrownRuns], place_of: Callable[[GrownRuns, Chain], Place | None]
) -> pd.DataFrame:
    """A row for each chain that has a place; none of runs in which no value varies."""
    rows = list[Line]()
    for runs in results:
        of_runs = list[Line]()
        for chain in runs.chains:
            if place := place_of(runs, chain):
                strategy = PUBLISHED["strategies"][runs.parts(chain)[1][0]]
                row: Line = {"benchmark": runs.settings.title, "line": place[0]}
                row |= {"value": place[1], "strategy": strategy}
                for name in (AFTER_ALL, MEASURES["base"], SECONDS):
                    row |= named(runs.all_measures.loc[chain], name, name)
                of_runs.append(row)
        if len({row["value"] for row in of_runs}) > 1:
            rows += of_runs
    return pd.DataFrame(rows)


@table("continual")
def grown(results: Sequence[GrownRuns]) -> Frames:
    """``MEASURES`` and seconds of each initializer with each strategy."""
    frames = dict[str, pd.DataFrame]()
    for runs in results:
        names = pd.DataFrame([runs.names(chain) for chain in runs.chains])
        measures = runs.measures.reset_index(drop=True)
        frames[f"grown_{runs.name}"] = pd.concat([names, measures], axis=1)
    return frames


@table("continual")
def matrices(results: Sequence[GrownRuns]) -> pd.DataFrame:
    """R[i, j]: MRR (points) of test set j after the training on snapshot i, mean over seeds."""
    parts = list[pd.DataFrame]()
    for runs in results:
        by_seed = pooled(runs.trained, [*RUN, "i", "j"])
        means = 100 * by_seed.groupby(level=[*CHAIN, "i", "j"]).mean()
        about = {"experiment": runs.name, "benchmark": runs.settings.title}
        for chain in runs.chains:
            of_chain = means.loc[chain].rename("MRR").reset_index()
            parts.append(of_chain.assign(**about, **runs.names(chain)))
    columns = ["experiment", "benchmark", *CHAIN, "i", "j", "MRR"]
    return pd.concat(parts)[columns]


@table("continual")
def after_last(results: Sequence[GrownRuns]) -> pd.DataFrame:
    """Published means over all test sets after the last snapshot, beside this run's."""
    return _beside_published(results, "after_last")


@table("continual")
def interference(results: Sequence[GrownRuns]) -> pd.DataFrame:
    """Published measures of interference, beside this run's."""
    return _beside_published(results, "interference")


def _beside_published(results: Sequence[GrownRuns], kind: str) -> pd.DataFrame:
    """A row for each published method, then for each chain of this run."""
    rows = list[Line]()
    for runs in results:
        for entry in PUBLISHED[kind]:
            about = {"benchmark": runs.settings.title, "protocol": entry["protocol"]}
            theirs = entry["rows"].get(runs.settings.timeline, {})
            for method, values in theirs.items():
                row: Line = {"method": method, "model": entry["model"], "source": entry["source"]}
                for name, value in zip(entry["measures"], values, strict=True):
                    row[name] = 100 * value
                rows.append(about | row)
            if theirs:
                model = f"{runs.settings.model}, d = {runs.settings.dimension}"
                measured = getattr(runs, kind)(entry["protocol"], entry["measures"])
                for chain, numbers in zip(runs.chains, measured.to_dict("records"), strict=True):
                    method = ", ".join(runs.names(chain).values())
                    row = {"method": method, "model": model, "source": "this run"}
                    rows.append(about | row | numbers)
    estimates = [f"{name}{end}" for name in PUBLISHED[kind][0]["measures"] for end in ENDS]
    columns = ["benchmark", "method", "model", "source", *estimates, "protocol"]
    return pd.DataFrame(rows, columns=columns)


@table("continual")
def faults(results: Sequence[GrownRuns]) -> pd.DataFrame:
    """The share of the queries of each test set that each fault touches, per cent."""
    parts = list[pd.DataFrame]()
    by_timeline = {runs.settings.timeline: runs for runs in results}
    for name, runs in by_timeline.items():
        shares = 100 * runs.faults.pivot(index="fault", columns="test", values="share")
        shares = shares.add_prefix("test ").reindex(list(PUBLISHED["faults"]))
        frame = shares.rename(index=PUBLISHED["faults"]).reset_index()
        frame.insert(0, "benchmark", name)
        parts.append(frame)
    return pd.concat(parts)
