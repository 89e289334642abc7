"""What ISI's gain over Xavier is made of: the centre of what is known, its kind, and what is left for meaning."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
import pandas as pd

from isi.report.models import BASELINE, controls, described, isi, label
from isi.report.paired import Difference, by_seed, difference
from isi.report.prose import joined
from isi.report.results import Experiment, Results
from isi.report.section import Bullets, Content, Section, Table, by_experiment
from isi.report.sections.differences import cells_of, signed
from isi.report.statistics import HALVES, HIGH, LOW, ratios

SCOPES = ("all", "novel")
_ASKED = {"all": "Over all queries", "novel": "About novel entities"}
#: Points of MRR* that are shown as 0.0.
NOTHING = 0.05
#: What each of these has that the one before it (at first, Xavier) has not; an initializer of ISI has the last.
_MEAN = "mean"
_STEPS = (("centre", _MEAN), ("kind", "kind_mean"))
_LAST = "meaning"
WHOLE = "all of it"
#: ISI's and the control that differs from it in one thing.
_TWINS = (("words", "es", "es_permuted"), ("words within a kind", "es", "es_permuted_kinds"))


@dataclass(frozen=True)
class Part:
    """What one model has that another has not, in one scope and half of immediate MRR*, in points."""

    scope: str
    #: a column of runs
    half: str
    #: what it is that it has
    what: str
    first: str
    second: str
    #: first less second
    points: Difference


@dataclass(frozen=True)
class Share:
    """What one control has of one ISI initializer's gain over Xavier, in points."""

    scope: str
    #: a column of runs
    half: str
    method: str
    gain: Difference
    control: str
    control_gain: Difference
    #: what the initializer has beyond the control
    rest: Difference
    #: the control's share of the gain and its interval; null where there is no gain to share
    percent: tuple[float, float, float]


def contents(results: Results) -> Iterator[Content]:
    """What each control is, then what every graph says; nothing where no control was run."""
    run = dict.fromkeys(name for one in results.own for name in controls(one.initializers))
    if not run:
        return
    yield (
        "The gap between ISI and Xavier mixes several things: known vectors have a centre and a spread of their own, "
        "those of a kind (objects, rooms, materials, affordances) have another, and Xavier has neither. Controls take "
        "these apart. What an initializer has beyond them is what words or relations tell of one entity and not of "
        "its kind."
    )
    yield Bullets([described(name) for name in run])
    yield from by_experiment(results, of_experiment)


def of_experiment(_results: Results, experiment: Experiment) -> Iterator[Content]:
    """Parts and shares, in words and as tables."""
    at_once, initializers = experiment.at_once, experiment.initializers
    shared = shares(at_once, initializers)
    if not shared:
        yield "Without Xavier, one of ISI and a control there is no gain to take apart."
        return
    found = parts(at_once, initializers)
    yield Bullets([sentence(found, scope, method) for scope in SCOPES for method in isi(initializers)
                   if any(one.scope == scope for one in found)])  # fmt: skip
    if told := of_the_centre(found):
        yield told
    yield parts_of_the_gain(found)
    yield shares_of_the_gain(shared)


def steps(method: str, models: Sequence[str]) -> list[tuple[str, str, str]]:
    """From Xavier to one of ISI over the controls that were run: what is had, by whom, and by whom not yet."""
    found, had, before = [], [], BASELINE
    for what, model in (*_STEPS, (_LAST, method)):
        had.append(what)
        if model in models:
            found.append((joined(had), model, before))
            had, before = [], model
    return found


def parts(at_once: pd.DataFrame, models: Sequence[str]) -> list[Part]:
    """Every step towards each initializer of ISI, its gain in one, and its twins, scope by scope and half by half."""
    found = []
    pairs = [step for method in isi(models) for step in steps(method, models)]
    pairs += [(WHOLE, method, BASELINE) for method in isi(models)]
    pairs += [twin for twin in _TWINS if {*twin[1:]} <= set(models)]
    for scope, half in product(SCOPES, HALVES):
        cells = 100 * cells_of(at_once, models, scope, half)
        for what, first, second in dict.fromkeys(pairs):
            points = difference(by_seed(cells[first], cells[second]))
            if points.seeds:
                found.append(Part(scope, half, what, first, second, points))
    return found


def shares(at_once: pd.DataFrame, models: Sequence[str]) -> list[Share]:
    """Of means by seed over sizes; empty where Xavier was not run."""
    found = []
    for scope, half in product(SCOPES if BASELINE in models else (), HALVES):
        cells = 100 * cells_of(at_once, models, scope, half)
        for method, control in product(isi(models), controls(models)):
            three = cells[[BASELINE, method, control]].dropna()
            gain, other = (by_seed(three[name], three[BASELINE]) for name in (method, control))
            if len(gain):
                found.append(
                    Share(scope, half, method, difference(gain), control, difference(other),
                          difference(by_seed(three[method], three[control])), _percent(other, gain))
                )  # fmt: skip
    return found


def _percent(part: np.ndarray, whole: np.ndarray) -> tuple[float, float, float]:
    if whole.mean() < NOTHING:
        return np.nan, np.nan, np.nan
    mean, low, high = (100 * ratios(part[None], whole[None])[0]).tolist()
    return mean, low, high


def parts_of_the_gain(found: Sequence[Part]) -> Table:
    """What the centre, the kind and the rest are worth, half by half."""
    lines: dict[tuple[str, str, str, str], dict[str, object]] = {}
    for one in found:
        line = lines.setdefault(
            (one.scope, one.what, one.first, one.second),
            {"scope": one.scope, "part": one.what, "what has it": label(one.first), "less": label(one.second)},
        )
        name = HALVES[one.half]
        line |= {name: one.points.mean, name + LOW: one.points.low, name + HIGH: one.points.high}
    return Table(
        "parts_of_the_gain",
        "Parts of the gain",
        "Paired differences in immediate MRR* (points), means over all sizes and seeds with their intervals over "
        "seeds, and of the half that asks for entities and the half that asks for relations. Centre: the mean of all "
        "that is known; kind: the mean of what is known of the same kind; meaning: what words or relations tell "
        "beyond these; words: against the same initializer with its word vectors dealt out at random.",
        pd.DataFrame(list(lines.values())),
        dict.fromkeys(HALVES.values(), signed),
    )


def shares_of_the_gain(found: Sequence[Share]) -> Table:
    """Each control's share of each ISI initializer's gain, and the rest."""
    lines = []
    for one in found:
        line: dict[str, object] = {"scope": one.scope, "of": HALVES[one.half], "ISI": label(one.method)}
        for name, points in (("gain over Xavier", one.gain), ("control's gain", one.control_gain), ("rest", one.rest)):
            line |= {name: points.mean, name + LOW: points.low, name + HIGH: points.high}
        line |= dict(zip(("share %", "share %" + LOW, "share %" + HIGH), one.percent, strict=True))
        lines.append(line | {"control": label(one.control)})
    order = ["scope", "of", "ISI", "gain over Xavier", "control", "control's gain", "share %", "rest"]
    columns = [name + end for name in order for end in ("", LOW, HIGH) if not lines or name + end in lines[0]]
    return Table(
        "shares_of_the_gain",
        "Shares of the gain",
        "Gains over Xavier in immediate MRR* and in its halves (points), means over all sizes and seeds; the share of "
        "ISI's gain that a control already has, and the rest in points, with intervals over seeds. No share where ISI "
        "gains nothing; a share is negative where the control is below Xavier, and the rest where it is above ISI.",
        pd.DataFrame(lines, columns=columns),
        folded=True,
    )


def sentence(found: Sequence[Part], scope: str, method: str) -> str:
    """What one initializer gains, and what that is made of; about novel entities half by half, too."""
    whole, entities, relations = (_half(found, scope, half, method) for half in HALVES)
    text = f"{_ASKED[scope]}, {label(method)} is {whole or 'not to be compared with Xavier'}."
    if scope == "all" or not (entities and relations):
        return text
    return f"{text} In the half that asks for entities, {entities}; in the half that asks for relations, {relations}."


def _half(found: Sequence[Part], scope: str, half: str, method: str) -> str:
    """One gain and its parts: the points of each, their shares where each adds to it, and the last's interval.

    Nothing where nothing was asked of both.
    """
    own = [one for one in found if (one.scope, one.half) == (scope, half)]
    gain = next((one.points for one in own if (one.first, one.second, one.what) == (method, BASELINE, WHOLE)), None)
    models = {name for one in own for name in (one.first, one.second)}
    made = [one for step in steps(method, sorted(models)) for one in own if (one.what, one.first, one.second) == step]
    if gain is None or not made:
        return ""
    shared = gain.mean >= NOTHING and min(one.points.mean for one in made) >= 0
    told = joined(
        f"{one.what} {one.points.mean:+.1f}{f' ({100 * one.points.mean / gain.mean:.0f} %)' if shared else ''}"
        for one in made
    )
    last = made[-1].points
    interval = "" if np.isnan(last.low) else f" [{last.low:+.1f}, {last.high:+.1f}]"
    return f"{gain.mean:+.1f} points from Xavier: {told}{interval}"


def of_the_centre(found: Sequence[Part]) -> str:
    """Where the gain of the centre about novel entities comes from; nothing where the control was not run."""
    own = {one.half: one.points for one in found if (one.scope, one.first, one.second) == ("novel", _MEAN, BASELINE)}
    if not {*HALVES} <= set(own):
        return ""
    whole, entities, relations = (own[half] for half in HALVES)
    text = (
        f"About novel entities, {label(_MEAN)} is {whole} points from Xavier: {entities} in the half that asks for "
        f"entities and {relations} in the half that asks for relations."
    )
    if whole.mean > 0 >= entities.mean:
        text += " All that the centre gains there is a choice of kind."
    return text


SECTION = Section("controls", "What the gain is made of", contents)
