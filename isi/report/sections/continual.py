"""Graphs that grow: what each initializer and strategy gains and harms, beside published numbers,
and what the faults of published protocols touch.
"""

from textwrap import fill
from typing import Any

import numpy as np
import pandas as pd
from matplotlib import colormaps
from matplotlib.figure import Figure as Canvas

from isi import config
from isi.continual.experiment import DEFAULT
from isi.report.continual import MEASURES, ContinualRuns
from isi.report.data import Results
from isi.report.figures import panels
from isi.report.section import Content, Contents
from isi.report.tables import Rows
from isi.report.words import BASELINE, TEMPLATES

#: Names of strategies and protocols, and published numbers with their sources.
ABOUT = config.read(TEMPLATES / "continual.yaml")
STRATEGIES: dict[str, str] = ABOUT["strategies"]
_MARKERS = "osD^v<>PX*"
_OURS = "this run"


def carried(results: Results) -> Contents:
    """For each experiment: what the default gains right after insertion, what it costs, and what
    training all rows on new facts alone would cost.
    """
    rows = Rows()
    for runs in results.continual:
        row = _at_a_glance(runs)
        if row:
            rows.append({"benchmark": runs.title} | row)
    if rows:
        yield Content({"first": rows[0], "last": rows[-1]}, {"carried": rows})


def _at_a_glance(runs: ContinualRuns) -> dict[str, Any]:
    """A row of the table ``carried``; nothing without the chains that it compares."""
    at_once, base, harm = (MEASURES[name][1] for name in ("at_once", "base", "interference"))
    by_chain: dict[tuple[str, str], Any] = {
        chain: row for chain, (_, row) in zip(runs.chains, runs.measures.iterrows(), strict=True)
    }
    inserted = {name: row for (name, strategy), row in by_chain.items() if strategy == "insert"}
    if not {DEFAULT, BASELINE} <= set(inserted):
        return {}
    named = {name: row[at_once].mean for name, row in inserted.items() if name != DEFAULT}
    best = max(named, key=named.__getitem__)
    row = {
        "new tests: Xavier": inserted[BASELINE][at_once],
        "new tests: default": inserted[DEFAULT][at_once],
        "new tests: best named": inserted[best][at_once],
        "best named": runs.name_of(best),
        "D of the default": inserted[DEFAULT][harm],
        "base test: before": inserted[DEFAULT][MEASURES["base_before"][1]],
        "base test: default": inserted[DEFAULT][base],
    }
    if (BASELINE, "finetune") in by_chain:
        row["base test: Xavier, all rows trained"] = by_chain[BASELINE, "finetune"][base]
    return row


def grown(results: Results) -> Contents:
    """Each initializer with each strategy: a table, R[i, j], and gain against harm."""
    for place, runs in enumerate(results.continual):
        rows = [
            _names(runs, *chain) | {name: row[name] for _, name in MEASURES.values()}
            for chain, (_, row) in zip(runs.chains, runs.measures.iterrows(), strict=True)
        ]
        figures = {"matrix": _matrices(runs), "gain_and_harm": _gain_and_harm(runs)}
        numbers = {"runs": runs, "first": place == 0, "shown": runs.name_of(runs.chains[0][0])}
        yield Content(numbers, {"grown": rows}, figures, f"_{runs.name}", runs.title)


def published_numbers(results: Results) -> Contents:
    """Numbers that others publish, with those of this run under the same protocol."""
    after_last, interference = Rows(), Rows()
    for runs in results.continual:
        for entry in ABOUT["after_last"]:
            theirs = entry["rows"].get(runs.settings.timeline, {})
            ours = _by_name(runs, runs.published(entry["protocol"])) if theirs else {}
            after_last += _beside(entry, theirs, ours, runs)
        for entry in ABOUT["interference"]:
            theirs = entry["rows"].get(runs.settings.timeline, {})
            ours = _by_name(runs, runs.interference()) if theirs else {}
            interference += _beside(entry, theirs, ours, runs)
    tables = {"after_last": after_last, "interference": interference}
    if any(tables.values()):
        yield Content({"about": ABOUT}, {name: rows for name, rows in tables.items() if rows})


def faults(results: Results) -> Contents:
    """The share of the queries of each test set that each fault touches, per cent."""
    rows = Rows()
    by_timeline = {runs.settings.timeline: runs for runs in results.continual}
    for name, runs in by_timeline.items():
        shares = 100 * runs.faults.pivot(index="fault", columns="test", values="share")
        for fault, words in ABOUT["faults"].items():
            of_tests = {f"test {test}": share for test, share in shares.loc[fault].items()}
            rows.append({"benchmark": name, "fault": words} | of_tests)
    if rows:
        yield Content(tables={"faults": rows})


def _names(runs: ContinualRuns, initializer: str, strategy: str) -> dict[str, Any]:
    of_strategy = STRATEGIES.get(strategy, strategy)
    return {"initializer": runs.name_of(initializer), "strategy": of_strategy}


def _by_name(runs: ContinualRuns, values: pd.DataFrame) -> dict[str, dict[Any, Any]]:
    """Values of each chain, by its name."""
    rows = zip(runs.chains, values.iterrows(), strict=True)
    return {", ".join(_names(runs, *chain).values()): row.to_dict() for chain, (_, row) in rows}


def _beside(
    entry: dict[str, Any],
    theirs: dict[str, list[float]],
    ours: dict[str, dict[Any, Any]],
    runs: ContinualRuns,
) -> Rows:
    """Rows of an entry of published numbers, then those of this run."""
    first = {"benchmark": runs.title}
    rows = Rows()
    for method, values in theirs.items():
        numbers = {name: 100 * value for name, value in zip(entry["measures"], values, strict=True)}
        about = {"method": method, "model": entry["model"], "source": entry["source"]}
        rows.append(first | about | numbers)
    for method, by_name in ours.items():
        numbers = {name: by_name[name] for name in entry["measures"]}
        about = {"method": method, "model": runs.model, "source": _OURS}
        rows.append(first | about | numbers)
    protocol = {"protocol": entry["protocol"]}
    return [row | protocol for row in rows]


def _matrices(runs: ContinualRuns) -> Canvas:
    """R[i, j] after the training on snapshot i, for each strategy of the first initializer."""
    first = runs.chains[0][0]
    strategies = runs.settings.strategies_of(first)
    canvas, axes = panels(len(strategies), 3, 2.6 * -(-len(strategies) // 3))
    matrices = [runs.score_matrix(first, strategy) for strategy in strategies]
    highest = np.nanmax(matrices)
    for panel, strategy, matrix in zip(axes, strategies, matrices, strict=True):
        panel.imshow(matrix, vmin=0, vmax=highest, cmap="Blues")
        for (i, j), value in np.ndenumerate(matrix):
            if not np.isnan(value):
                colour = "#ffffff" if value > 0.6 * highest else "#000000"
                panel.text(j, i, f"{value:.0f}", ha="center", va="center", color=colour, size=7)
        ticks = range(len(matrix))
        panel.set_xticks(ticks)
        panel.set_yticks(ticks)
        panel.grid(visible=False)
        title = fill(STRATEGIES.get(strategy, strategy), 26)
        panel.set(title=title, xlabel="test set j")
        panel.set_ylabel("after snapshot i")
    return canvas


def _gain_and_harm(runs: ContinualRuns) -> Canvas:
    """MRR about new tests against what the base test loses, a mark for each initializer and
    strategy; a line joins one initializer with several options: its frontier.
    """
    canvas, (axes,) = panels(1, 1, 4.6)
    initializers, strategies = (
        list(dict.fromkeys(names)) for names in zip(*runs.chains, strict=True)
    )
    colours = colormaps["tab10"].colors  # type: ignore[attr-defined]
    gain, before, after = (MEASURES[name][1] for name in ("trained", "base_before", "base"))
    frontiers: dict[tuple[str, str], list[tuple[float, float]]] = {}
    for (initializer, strategy), (_, row) in zip(
        runs.chains, runs.measures.iterrows(), strict=True
    ):
        colour = colours[initializers.index(initializer) % len(colours)]
        marker = _MARKERS[strategies.index(strategy) % len(_MARKERS)]
        harm = row[before].mean - row[after].mean
        axes.plot(harm, row[gain].mean, ls="", marker=marker, color=colour, ms=6)
        dial = runs.settings.initializer_of(initializer)[0], strategy
        frontiers.setdefault(dial, []).append((harm, row[gain].mean))
    for frontier in frontiers.values():
        axes.plot(*zip(*sorted(frontier), strict=True), color="#777777", lw=0.8, zorder=1)
    for place, initializer in enumerate(initializers):
        colour = colours[place % len(colours)]
        axes.plot([], [], ls="", marker="s", color=colour, label=runs.name_of(initializer))
    for place, strategy in enumerate(strategies):
        marker = _MARKERS[place % len(_MARKERS)]
        name = STRATEGIES.get(strategy, strategy)
        axes.plot([], [], ls="", marker=marker, color="#777777", label=name)
    axes.set(title="gain and harm", xlabel="harm: what the base test loses in the end (points)")
    axes.set_ylabel("gain: MRR of new tests after training (points)")
    canvas.legend(loc="outside lower center", ncols=3)
    return canvas
