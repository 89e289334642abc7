"""Graphs that grow: what each initializer and strategy gains and harms, beside published numbers,
and what the faults of published protocols touch.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pandas as pd

from isi import config
from isi.report.tables.data import BASELINE, Models, read
from isi.report.tables.estimates import ENDS, Names, named, over_seeds, where
from isi.report.tables.registry import Frames, table

if TYPE_CHECKING:
    from isi.continual.experiment import ContinualExperiment

#: Names of strategies and faults, and published numbers with their sources.
PUBLISHED = config.read(Path(__file__).with_name("published.yaml"))
#: In place of an initializer's name: the best by the hold-out test.
DEFAULT = "default"
CHAIN = ["initializer", "strategy"]  #: Columns that name chains of several seeds.
RUN = [*CHAIN, "seed"]  #: Columns that name one chain.
#: Measures of ``GrownRuns.measures`` with their headers.
MEASURES = {
    "at_once": "new tests, at once",
    "trained": "new tests, after training",
    "base_before": "base test, before",
    "base": "base test, in the end",
    "interference": "D",
}


def pooled(rows: pd.DataFrame, by: Names, measure: str = "mrr") -> pd.Series:
    """A measure over all queries that agree in the columns ``by``."""
    weighted = rows.assign(total=rows[measure] * rows["queries"])
    sums = weighted.groupby(list(by))[["total", "queries"]].sum()
    return sums["total"] / sums["queries"]


def _by_update(rows: pd.DataFrame) -> pd.Series:
    """MRR of each chain: the mean over pairs of an update and a slot."""
    means: pd.Series = pooled(rows, [*RUN, "i", "slot"]).groupby(level=RUN).mean()
    return means


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

    def names(self, chain: tuple[str, str]) -> dict[str, str]:
        """The display names of an initializer of params, or of the choice among them, and of a
        strategy.
        """
        key, strategy = chain
        initializer, options = self.settings.initializer_of(key)
        shown = DEFAULT
        if key != DEFAULT:
            changed = [] if key == initializer else [f"{name} {options[name]}" for name in options]
            shown = ", ".join([self.models.labels[initializer], *changed])
        strategies: Mapping[str, str] = PUBLISHED["strategies"]
        return {"initializer": shown, "strategy": strategies.get(strategy, strategy)}

    def over_seeds(self, values: Mapping[str, pd.Series], scale: float = 100) -> pd.DataFrame:
        """Means of values by chain and seed, with intervals; rows are ``chains``."""
        frame = pd.DataFrame(values).rename_axis(RUN).reset_index()
        means = over_seeds(frame, CHAIN, {name: name for name in values}, scale)
        return means.reindex(self.chains)

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

    @cached_property
    def measures(self) -> pd.DataFrame:
        """``MEASURES`` in points, and seconds, by chain."""
        current, last = where(self.rows, protocol="current"), self.rows["i"].max()
        new = current[(current["i"] == current["j"]) & (current["i"] > 0)]
        base = where(self.trained, j=0)
        points = {
            "at_once": pooled(where(new, phase="inserted"), RUN),
            "trained": pooled(where(new, phase="trained"), RUN),
            "base_before": pooled(where(base, i=0), RUN),
            "base": pooled(where(base, i=last), RUN),
            "interference": self.historical("old") - self.historical("current"),
        }
        means = self.over_seeds({MEASURES[name]: values for name, values in points.items()})
        seconds = self.costs.groupby(RUN)["seconds"].sum()
        return pd.concat([means, self.over_seeds({"seconds": seconds}, scale=1)], axis=1)

    def after_last(self, protocol: str, measures: Names) -> pd.DataFrame:
        """Means of measures over all test sets after the last snapshot, points."""
        rows = where(self.rows, protocol=protocol, phase="trained", i=self.rows["i"].max())
        values = dict[str, pd.Series]()
        for name in measures:
            values[name] = pooled(rows, [*RUN, "j"], name).groupby(level=RUN).mean()
        return self.over_seeds(values)

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


@table("continual")
def carried(results: Sequence[GrownRuns]) -> pd.DataFrame:
    """For each experiment: what the default gains right after insertion, what it costs, and what
    training all rows on new facts alone would cost.
    """
    rows = list[dict[str, Any]]()
    for runs in results:
        records = runs.measures.to_dict("records")
        by_chain: dict[tuple[str, str], Any] = dict(zip(runs.chains, records, strict=True))
        inserted = {name: row for (name, strategy), row in by_chain.items() if strategy == "insert"}
        if not {DEFAULT, BASELINE} <= set(inserted):
            continue
        at_once = {name: row[MEASURES["at_once"]] for name, row in inserted.items()}
        best = max((name for name in inserted if name != DEFAULT), key=at_once.__getitem__)
        row: dict[str, Any] = {"benchmark": runs.settings.title}
        for title, chain, measure in (
            ("new tests: Xavier", (BASELINE, "insert"), "at_once"),
            ("new tests: default", (DEFAULT, "insert"), "at_once"),
            ("new tests: best named", (best, "insert"), "at_once"),
            ("best named", (best, "insert"), ""),
            ("D of the default", (DEFAULT, "insert"), "interference"),
            ("base test: before", (DEFAULT, "insert"), "base_before"),
            ("base test: default", (DEFAULT, "insert"), "base"),
            ("base test: Xavier, all rows trained", (BASELINE, "finetune"), "base"),
        ):
            if not measure:
                row[title] = runs.names(chain)["initializer"]
            elif chain in by_chain:
                row |= named(by_chain[chain], MEASURES[measure], title)
        rows.append(row)
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
        for chain in runs.chains:
            of_chain = means.loc[chain].rename("MRR").reset_index()
            about = {"experiment": runs.name, "benchmark": runs.settings.title}
            columns = pd.DataFrame([about | runs.names(chain)] * len(of_chain))
            parts.append(pd.concat([columns, of_chain], axis=1))
    return pd.concat(parts) if parts else pd.DataFrame()


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
    rows = list[dict[str, Any]]()
    for runs in results:
        for entry in PUBLISHED[kind]:
            first = {"benchmark": runs.settings.title}
            protocol = {"protocol": entry["protocol"]}
            theirs = entry["rows"].get(runs.settings.timeline, {})
            for method, values in theirs.items():
                about = {"method": method, "model": entry["model"], "source": entry["source"]}
                numbers = dict(
                    zip(entry["measures"], [100 * value for value in values], strict=True)
                )
                rows.append(first | about | numbers | protocol)
            if theirs:
                model = f"{runs.settings.model}, d = {runs.settings.dimension}"
                measured = getattr(runs, kind)(entry["protocol"], entry["measures"])
                for chain, numbers in zip(runs.chains, measured.to_dict("records"), strict=True):
                    method = ", ".join(runs.names(chain).values())
                    about = {"method": method, "model": model, "source": "this run"}
                    rows.append(first | about | numbers | protocol)
    measures = PUBLISHED[kind][0]["measures"]
    estimates = [f"{name}{end}" for name in measures for end in ENDS]
    columns = ["benchmark", "method", "model", "source", *estimates, "protocol"]
    return pd.DataFrame(rows, columns=columns)


@table("continual")
def faults(results: Sequence[GrownRuns]) -> pd.DataFrame:
    """The share of the queries of each test set that each fault touches, per cent."""
    rows = list[dict[str, Any]]()
    by_timeline = {runs.settings.timeline: runs for runs in results}
    for name, runs in by_timeline.items():
        shares = 100 * runs.faults.pivot(index="fault", columns="test", values="share")
        for fault, words in PUBLISHED["faults"].items():
            of_tests = shares.loc[fault].add_prefix("test ").to_dict()
            rows.append({"benchmark": name, "fault": words} | of_tests)
    return pd.DataFrame(rows)
