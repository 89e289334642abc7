"""What the paper claims, and how far these runs repeat it, by one rule (``verdict``)."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import pandas as pd

from stages.report.tables.affordances import table3_affordances
from stages.report.tables.data import Results
from stages.report.tables.estimates import ENDS, TableRow
from stages.report.tables.method import indicator_sizes, run, sensitivity
from stages.report.tables.paper import inside, paper_results
from stages.report.tables.registry import table
from stages.report.tables.results import differences, gains, transfer_immediate

#: ES, RS and ERS, which the paper proposes, by label.
ISI = ("ES", "RS", "ERS")
#: The other four that the paper compares with Xavier.
OTHERS = ("IU", *ISI)
#: Kinds of results that are not in ``paper_results``, but that the paper's claims rest on.
FEWER_WITH_MORE = "epochs saved by more indicators"
PICKED = "indicators by the rule"
ON_AVERAGE = "mean gain of ISI (%)"
RIGHT = "affordances among the first answers"
#: The number of indicators from which the paper claims a trade-off, and the most in Figure 2.
FEW, MOST = 4, 30
#: Two things of which the first is greater, each a name or a number.
Pair = tuple[str | float, str | float]


@dataclass(frozen=True)
class Claim:
    """A claim of the paper: results of one kind, and an order of some of them."""

    claim: str
    place: str  #: in the paper: a section or a table
    kind: str  #: of the results
    methods: Sequence[str]
    order: Sequence[Pair] = ()
    paired: str = ""  #: the measure of ``differences`` whose intervals decide the order
    once: bool = False  #: whether the paper prints one number for ES, RS and ERS
    seeds: Sequence[str] = ("paper.sessions.seeds",)  #: ends of names in the table ``run``


def each(greater: Sequence[str], than: str | float) -> list[Pair]:
    """An order in which each of some names is above one thing."""
    return [(name, than) for name in greater]


CLAIMS = (
    Claim(
        f"MRR falls after a few indicators (the best number, below {MOST})",
        "5.3",
        "best number of indicators",
        ISI,
        [(float(MOST), name) for name in ISI],
        once=True,
        seeds=["sweep.seeds"],
    ),
    Claim(
        f"After {FEW}, more indicators need fewer epochs (epochs saved with {MOST})",
        "5.3",
        FEWER_WITH_MORE,
        ISI,
        each(ISI, 0.0),
        seeds=["sweep.finetuned_seeds"],
    ),
    Claim(
        "The rule picks these numbers of indicators",
        "5.3",
        PICKED,
        ISI,
        seeds=["sweep.seeds", "sweep.finetuned_seeds"],
    ),
    Claim(
        "ISI answers better than Xavier and IU right after insertion (gain over Xavier, %)",
        "6.1",
        "gain over Xavier (%)",
        ISI,
        [*each(ISI, "Xavier"), *each(ISI, "IU")],
        paired="MRR, weighted",
    ),
    Claim(
        "The gain of ISI on average, as printed and as the mean of the printed three (%)",
        "abstract",
        ON_AVERAGE,
        ("as printed", "of the three"),
        each(("as printed",), 0.0),
    ),
    Claim(
        "ISI needs fewer epochs than Xavier (%)",
        "6.2",
        "fewer epochs than Xavier (%)",
        (*ISI, "mean of ISI"),
        each((*ISI, "mean of ISI"), 0.0),
        seeds=["paper.finetuned.seeds"],
    ),
    Claim(
        "Xavier needs more epochs than IU, and IU more than ISI (the order of Table 2)",
        "Table 2",
        "epochs to convergence",
        ("Xavier", *OTHERS),
        [("Xavier", "IU"), *(("IU", name) for name in ISI)],
        paired="epochs to convergence",
        seeds=["paper.finetuned.seeds"],
    ),
    Claim(
        "After transfer, ISI answers better than Xavier (MRR, weighted)",
        "6.3",
        "transfer: weighted",
        ("Xavier", *ISI),
        each(ISI, "Xavier"),
        seeds=["paper_transfer.sessions.seeds"],
    ),
    Claim(
        "About the new entities, ISI answers better than IU (MRR)",
        "6.3",
        "transfer: novel entities",
        ("IU", *ISI),
        each(ISI, "IU"),
        seeds=["paper_transfer.sessions.seeds"],
    ),
    Claim(
        "After transfer, Xavier needs the most epochs",
        "6.3",
        "transfer: epochs to convergence",
        ("Xavier", *OTHERS),
        [("Xavier", name) for name in OTHERS],
        seeds=["paper_transfer.finetuned.seeds"],
    ),
    Claim(
        "After transfer, no other needs any (“only Xavier required”)",
        "6.3",
        "transfer: epochs to convergence",
        OTHERS,
        [(0.0, name) for name in OTHERS],
        seeds=["paper_transfer.finetuned.seeds"],
    ),
    Claim(
        "Xavier harms earlier knowledge, ISI hardly (drop of MRR, %)",
        "6.3",
        "transfer: drop (%)",
        ("Xavier", *ISI),
        [("Xavier", name) for name in ISI],
        seeds=["paper_transfer.sessions.seeds"],
    ),
    Claim(
        "ISI names more affordances than Xavier (of 12 answers, among all entities)",
        "Table 3",
        RIGHT,
        ("Xavier", *ISI),
        each(ISI, "Xavier"),
        once=True,
        seeds=[RIGHT],
    ),
)


@table("report")
def claims(results: Results) -> pd.DataFrame | None:
    """The paper's claims with its numbers, ours on both graphs, and a verdict on the first."""
    answers, params = table3_affordances(results), run(results)
    parts = [paper_results(results)]
    for statistic, frame, extended in (
        (fewer_with_more, sensitivity(results), False),
        (picked, indicator_sizes(results), False),
        (mean_gain, gains(results), False),
        (drops, transfer_immediate(results), True),
        (right_answers, answers, True),
    ):
        titles = [getattr(results.on(papers, extended), "title", "") for papers in (True, False)]
        if frame is not None:
            both = [statistic(frame[frame["graph"] == title]) for title in titles]
            parts.append(side_by_side(*both))
    frame = printed(pd.concat(parts, ignore_index=True), results.paper)
    pairs, seeds = differences(results), dict(zip(params["name"], params["value"], strict=True))
    of_graph = getattr(results.on(papers=True), "title", "")
    if answers is not None:
        transfer = getattr(results.on(papers=True, extended=True), "title", "")
        entities = answers.loc[answers["graph"] == transfer, "entity"].unique()
        seeds[RIGHT] = ", ".join(re.findall(r"n = (\d+)", " ".join(entities)))
    return judged(frame, None if pairs is None else pairs[pairs["graph"] == of_graph], seeds)


def printed(rows: pd.DataFrame, paper: Mapping[str, Any]) -> pd.DataFrame:
    """The rows with the paper's numbers of kinds that are not in ``paper_results``. A count has no
    interval: it is inside if it is equal; right answers are of no named method of ISI.
    """
    gains_of, picks = paper["immediate"], paper.get("indicators", {})
    three = pd.Series(gains_of["improvement_over_xavier"], dtype=float)
    average = gains_of.get("improvement_in_the_abstract")
    answers = paper.get("affordances", {})
    numbers = {(PICKED, name): picks.get(name.lower()) for name in ISI}
    numbers |= {(ON_AVERAGE, "as printed"): average, (ON_AVERAGE, "of the three"): three.mean()}
    numbers |= {(RIGHT, name): answers.get("isi") for name in ISI}
    numbers[RIGHT, "Xavier"] = answers.get("xavier")
    keys = list(zip(rows["kind"], rows["whose"], strict=True))
    theirs = pd.Series([numbers.get(key) for key in keys], rows.index, dtype=float)
    counted = {(PICKED, name) for name in ISI} | {(ON_AVERAGE, "as printed")}
    bounds = [rows[f"ours{end}"] for end in ENDS]
    is_inside = [
        inside(number, ours) if key in counted and number == number else old
        for key, number, ours, old in zip(
            keys, theirs, zip(*bounds, strict=True), rows["inside"], strict=True
        )
    ]
    return rows.assign(paper=rows["paper"].fillna(theirs), inside=is_inside)


def judged(
    results: pd.DataFrame,
    differences: pd.DataFrame | None = None,
    seeds: Mapping[str, str] | None = None,
) -> pd.DataFrame | None:
    """A row for each claim all of whose results are there on the paper's graph; ``results``: as
    rows of ``paper_results``; ``differences``: paired ones on this graph; ``seeds``: by name.
    """
    rows = list[TableRow]()
    for claim in CLAIMS:
        of_kind = results[results["kind"] == claim.kind].set_index("whose")
        of_kind = of_kind.reindex(list(claim.methods))
        if of_kind["ours"].isna().any():
            continue
        paired = bounds_of(differences, claim.paired)
        order = [standing(pair, of_kind, paired) for pair in claim.order]
        numbers = within(of_kind, claim.once)
        theirs = of_kind.drop(index=list(ISI[1:])) if claim.once else of_kind
        row: TableRow = {"claim": claim.claim, "where": claim.place}
        row["method"] = ", ".join(claim.methods)
        row["paper"] = written(theirs["paper"]) + " (ISI)" * claim.once
        row["the paper's graph"] = written(of_kind["ours"])
        row["today's graph"] = written(of_kind["today's graph"])
        row["order"] = share([held is True for held in order])
        row["numbers"] = share(numbers)
        row["seeds"] = ", ".join(
            value
            for end in claim.seeds
            for name, value in (seeds or {}).items()
            if name.endswith(end)
        )
        rows.append(row | {"verdict": verdict(order, numbers)})
    return pd.DataFrame(rows) if rows else None


def bounds_of(differences: pd.DataFrame | None, measure: str) -> dict[Pair, tuple[float, float]]:
    """The intervals of paired differences in a measure, first minus second, both ways round."""
    bounds = dict[Pair, tuple[float, float]]()
    if differences is not None:
        of_measure = differences[differences["measure"] == measure]
        columns = ["first", "second", "difference low", "difference high"]
        for first, second, low, high in of_measure[columns].itertuples(index=False):
            bounds |= {(first, second): (low, high), (second, first): (-high, -low)}
    return bounds


def standing(
    pair: Pair, of_kind: pd.DataFrame, paired: Mapping[Pair, tuple[float, float]]
) -> bool | None:
    """Whether a pair has its order; None where the intervals allow the opposite, too: that of the
    paired difference, or, without one, both that do not overlap.
    """
    if pair in paired:
        low, high = paired[pair]
    else:
        (low, high), (least, most) = (_bounds(side, of_kind) for side in pair)
        low, high = low - most, high - least
    return True if low > 0 else False if high < 0 else None


def _bounds(side: str | float, of_kind: pd.DataFrame) -> tuple[float, float]:
    """The interval of a name, or of a number."""
    if not isinstance(side, str):
        return side, side
    result = of_kind.reindex([side]).iloc[0]
    return float(result["ours low"]), float(result["ours high"])


def within(of_kind: pd.DataFrame, once: bool = False) -> list[bool]:
    """Whether each number of the paper lies within our interval, in either form; ``once``: it has
    one for ES, RS and ERS, which has to lie within all.
    """
    known = of_kind[of_kind["inside"].isin(["yes", "no"])]
    holds = (known["inside"] == "yes") | (known["inside in it"] == "yes")
    of_all = holds.index.isin(ISI)
    if once and of_all.any():
        return [*holds[~of_all], bool(holds[of_all].all())]
    return list(holds)


def share(checks: Sequence[bool]) -> str:
    """How many of some checks hold."""
    return f"{sum(checks)} of {len(checks)}" if checks else "–"


def verdict(order: Sequence[bool | None], numbers: Sequence[bool]) -> str:
    """``undecided`` if no pair has the order or its opposite; else ``repeated`` if all pairs and
    numbers hold, ``not repeated`` if none does, and ``partly``.
    """
    if order and all(held is None for held in order):
        return "undecided"
    checks = [*(held is True for held in order), *numbers]
    if all(checks):
        return "repeated"
    return "partly" if any(checks) else "not repeated"


def written(values: pd.Series) -> str:
    """Numbers in one text, all with a decimal or none; "–" where there is none."""
    known = values.dropna()
    form = ".0f" if (known % 1 == 0).all() else ".1f"
    texts = ["–" if pd.isna(value) else format(value, form) for value in values]
    return ", ".join(texts).replace("-", "−") if len(known) else "–"


# Results that the paper does not print: the statistic of one graph by name, with its bounds


def side_by_side(papers: pd.DataFrame, todays: pd.DataFrame) -> pd.DataFrame:
    """A statistic on both graphs, as rows of ``paper_results``."""
    return papers.assign(**{"today's graph": todays["ours"]}).rename_axis("whose").reset_index()


def fewer_with_more(swept: pd.DataFrame) -> pd.DataFrame:
    """Epochs with ``FEW`` indicators minus those with the most, with the bounds of both."""
    columns = [f"epochs{end}" for end in ENDS]
    few = swept[swept["indicators"] == FEW].set_index("initializer")[columns].reindex(ISI)
    many = swept.groupby("initializer")[columns].last().reindex(ISI)
    parts = {
        "ours": few[columns[0]] - many[columns[0]],
        "ours low": few[columns[1]] - many[columns[2]],
        "ours high": few[columns[2]] - many[columns[1]],
    }
    return pd.DataFrame(parts).assign(kind=FEWER_WITH_MORE)


def picked(sizes: pd.DataFrame) -> pd.DataFrame:
    """The numbers of indicators that the paper's rule picks; a number has no interval."""
    numbers = sizes.set_index("initializer")["picked by the rule"].reindex(ISI).astype(float)
    return pd.DataFrame(dict.fromkeys((f"ours{end}" for end in ENDS), numbers)).assign(kind=PICKED)


def mean_gain(gained: pd.DataFrame) -> pd.DataFrame:
    """The mean gain of ES, RS and ERS. Its bounds are the means of theirs, which its own interval
    does not exceed.
    """
    columns = {f"gain, %{end}": f"ours{end}" for end in ENDS}
    of_isi = gained.set_index("initializer")[list(columns)].reindex(ISI)
    mean = of_isi.mean(skipna=False).rename(columns)
    return pd.DataFrame([mean, mean], ["as printed", "of the three"]).assign(kind=ON_AVERAGE)


def drops(transferred: pd.DataFrame) -> pd.DataFrame:
    """By how much ES, RS and ERS are below the mean about earlier knowledge, which the paper shows
    in a figure alone.
    """
    columns = {f"known: drop, %{end}": f"ours{end}" for end in ENDS}
    of_isi = transferred.set_index("model")[list(columns)].rename(columns=columns).reindex(ISI)
    return of_isi.assign(kind="transfer: drop (%)")


def right_answers(answers: pd.DataFrame) -> pd.DataFrame:
    """The number of answers of the right kind among the first ones about all entities; a count has
    no interval.
    """
    names = [name for name in ("Xavier", *ISI) if name in answers and answers[name].notna().any()]
    rights = {name: (~answers[name].str.startswith("×")).sum() for name in names}
    counts = pd.Series(rights, dtype=float)
    bounds = dict.fromkeys((f"ours{end}" for end in ENDS), counts)
    return pd.DataFrame(bounds).reindex(["Xavier", *ISI]).assign(kind=RIGHT)
