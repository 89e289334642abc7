"""Earlier knowledge during fine-tuning: crowding against damage."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import pandas as pd
from matplotlib.figure import Figure as Canvas

from isi.report import wording
from isi.report.figures import by_epoch
from isi.report.models import BASELINE, JOINT, NOTHING, contenders, isi, label
from isi.report.paired import LEVEL, Pair, compare
from isi.report.prose import capitalized, joined, listed
from isi.report.results import Experiment, Results
from isi.report.section import Content, Figure, Section, Table, by_experiment
from isi.report.sections.differences import cells_of, every_pair
from isi.report.statistics import HALVES, HIGH, LOW, mrr_star, over_seeds

SCOPES = ("known", "known_closed")
_CELL = ["session", "size", "seed"]
#: Of the figure, here and for the transfer.
CAPTION = (
    "with the novel entities among the candidates (left) and without (right, where all start at zero by definition). A "
    "loss on the left alone is crowding, a loss on the right is damage. Scales differ."
)


def contents(results: Results) -> Iterator[Content]:
    """What crowding is called, then the same of every graph."""
    yield (
        "Queries about entities that were known before are asked twice: with the novel entities among the candidates "
        "(earlier knowledge) and without (earlier knowledge by itself). What is lost in the former alone is crowding, "
        "novel entities that rank above the answers; Pons, Escolano, Bilalli and Queralt "
        "([arXiv 2604.19401](https://arxiv.org/abs/2604.19401)) call it entity interference. What is lost in the "
        "latter is damage. At once there can be none: known vectors and relations are as they were, so all have the "
        "same there, by definition and not as a finding. Only training can tell them apart."
    )
    yield from by_experiment(results, of_experiment)


def of_experiment(results: Results, experiment: Experiment) -> Iterator[Content]:
    """What is lost at once, and by epoch at the size whose curves are drawn."""
    yield in_words(experiment.at_once, experiment.initializers)
    size = experiment.curve_size
    if size is None:
        yield f"No size in `experiments.{experiment.name}.full_curves` was inserted, so there is no curve to draw."
        return
    runs = with_nothing(results, experiment)
    pairs = at_the_end(runs)
    yield at_the_end_in_words(pairs)
    yield Figure(
        "corruption",
        "Earlier knowledge during fine-tuning",
        f"MRR* of queries about known entities at |ξ| = {size}, less what Θ⁰ had before anything was inserted, paired "
        f"by seed: mean and (but for controls) 95 % interval over seeds, {CAPTION}",
        drawn(runs, experiment.models),
    )
    yield corruption(runs, [*experiment.models, NOTHING], size)
    yield differences_at_the_end(pairs)


def in_words(at_once: pd.DataFrame, initializers: Sequence[str]) -> str:
    """Crowding at once."""
    now, tested = mrr_star(at_once, initializers), contenders(initializers)
    crowded, alone = (now.get(scope, {}) for scope in SCOPES)
    before = next(iter(alone.values()), float("nan"))
    return (
        f"At once, over all sizes: {before:.1f} without the novel entities, whoever inserts them, and with them "
        f"{listed(crowded, tested)}."
    )


def with_nothing(results: Results, experiment: Experiment) -> pd.DataFrame:
    """The runs whose curves are drawn, those with nothing inserted among them where there are any."""
    runs = results.nothing.get(experiment.name)
    if runs is None:
        return experiment.curves
    own = runs[(runs["size"] == experiment.curve_size) & (runs["scope"] == "known_closed")]
    return pd.concat([experiment.curves, own.assign(model=NOTHING)], ignore_index=True)


def since_before(runs: pd.DataFrame) -> pd.DataFrame:
    """Runs about known entities, less what Θ⁰ had in the same cell before anything was inserted.

    That is MRR* in known_closed at once, the same for all but the joint model.
    """
    own = runs[runs["scope"].isin(SCOPES)]
    start = own[(own["scope"] == "known_closed") & (own["epoch"] == 0) & ~own["model"].isin([JOINT, NOTHING])]
    before = start.drop_duplicates(_CELL).set_index(_CELL)["mrr_star"].rename("before")
    joined_up = own.join(before, on=_CELL)
    return joined_up.assign(mrr_star=joined_up["mrr_star"] - joined_up["before"]).drop(columns="before")


def drawn(runs: pd.DataFrame, models: Sequence[str]) -> Canvas:
    """By epoch, a panel for each scope: how far from before anything was inserted."""
    lines = [*(model for model in models if model != JOINT), NOTHING]
    return by_epoch(since_before(runs), lines, SCOPES, ylabel="MRR* less before (points)")


def at_the_end(runs: pd.DataFrame) -> list[Pair]:
    """Contenders, and nothing inserted, in pairs after the last epoch, in points; one measure for each scope."""
    epoch = runs["epoch"].max()
    last = runs[runs["epoch"] == epoch]
    ran = list(dict.fromkeys(last["model"]))
    models = [*contenders(name for name in ran if name not in (JOINT, NOTHING)), *({NOTHING} & set(ran))]
    found = []
    for scope in SCOPES:
        asked = last[last["scope"] == scope]
        there = [model for model in models if model in set(asked["model"])]
        found += compare({f"{scope}, epoch {epoch}": 100 * cells_of(asked, there, scope, "mrr_star")}, there)
    return found


def against(pairs: Sequence[Pair], scope: str, model: str) -> Mapping[str, Pair]:
    """ISI against one model in one scope, by initializer."""
    return {one.first: one for one in pairs
            if one.measure.startswith(f"{scope},") and one.second == model and isi([one.first])}  # fmt: skip


def named(found: Mapping[str, Pair]) -> str:
    """Each initializer with its difference, and whether it is told apart."""
    return joined(f"{label(name)} {one}{'' if one.told_apart else ' (n.s.)'}" for name, one in found.items())


def at_the_end_in_words(pairs: Sequence[Pair]) -> str:
    """Damage and crowding at the end, ISI against Xavier and against nothing inserted."""
    told = []
    for scope, model in (("known_closed", BASELINE), ("known", BASELINE), ("known_closed", NOTHING)):
        if found := against(pairs, scope, model):
            told.append(f"{wording.SCOPES[scope]} against {label(model)}: {named(found)}")
    if not told:
        return "Nobody was followed to the end with whom ISI could be compared."
    return (
        "At the end of training, differences in points of MRR*, paired by seed (n.s.: Holm-corrected p of "
        f"{LEVEL:g} or more). {'. '.join(map(capitalized, told))}."
    )


def corruption(runs: pd.DataFrame, models: Sequence[str], size: int) -> Table:
    """Known against known_closed: crowding against damage, in runs of one size."""
    lines = []
    for model in models:
        for scope in SCOPES:
            own = runs[(runs["model"] == model) & (runs["scope"] == scope)]
            if len(own):
                lowest = 100 * own.groupby("epoch")["mrr_star"].mean().min()
                line = {"model": label(model), "scope": scope, "lowest MRR*": lowest}
                for when, epoch in (("at once", own["epoch"].min()), ("at the end", own["epoch"].max())):
                    means = over_seeds(own[own["epoch"] == epoch], ["epoch"], HALVES).iloc[0]
                    line |= {_when(str(name), when): value for name, value in means.items()}
                lines.append(line)
    return Table(
        "corruption",
        "Earlier knowledge: crowding or damage",
        f"MRR* (points) of queries about known entities at |ξ| = {size}, mean and interval over seeds, with its "
        "entity and its relation half, with the novel entities among the candidates (earlier knowledge) and without "
        "(by itself). What is lost only in the former is crowding: novel entities rank above the answers. What is "
        "lost in the latter is damage. Lowest: over all epochs.",
        pd.DataFrame(lines),
    )


def _when(column: str, when: str) -> str:
    """The name of a column at some time; ends of intervals stay at its end."""
    for end in (LOW, HIGH):
        if column.endswith(end):
            return f"{column.removesuffix(end)} {when}{end}"
    return f"{column} {when}"


def differences_at_the_end(pairs: Sequence[Pair], name: str = "earlier_at_the_end") -> Table:
    """Every pair at the end of training."""
    return every_pair(
        name,
        "Earlier knowledge at the end of training: every pair",
        "First less second in MRR* (points) of queries about known entities after the last epoch, paired by seed, with "
        "the novel entities among the candidates (earlier knowledge) and without (by "
        "itself).",
        pairs,
    )


SECTION = Section("earlier", "What becomes of earlier knowledge", contents)
