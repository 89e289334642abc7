"""What the paper claims, and how far these runs repeat it, by one rule (``verdict``)."""

from collections.abc import Sequence
from dataclasses import dataclass

import pandas as pd

from stages.report.tables.affordances import table3_affordances
from stages.report.tables.data import Results
from stages.report.tables.estimates import ENDS, TableRow
from stages.report.tables.method import sensitivity
from stages.report.tables.paper import paper_results
from stages.report.tables.registry import table
from stages.report.tables.results import gains

#: ES, RS and ERS, which the paper proposes, by label.
ISI = ("ES", "RS", "ERS")
#: Kinds of results that the paper does not print, but that its claims rest on.
BEYOND_THE_CENTRE = "part of the gain beyond Mean (%)"
FEWER_WITH_MORE = "fewer epochs with more indicators"
RIGHT = "affordances among the first answers"


@dataclass(frozen=True)
class Claim:
    """A claim of the paper: results of one kind, and an order of some of them."""

    claim: str
    place: str  #: in the paper: a section or a table
    kind: str  #: of the results
    whose: Sequence[str]
    #: pairs of names, or of a name and a number, of which the first is greater
    order: Sequence[tuple[str, str | float]] = ()


def each(greater: Sequence[str], than: str | float) -> list[tuple[str, str | float]]:
    """An order in which each of some names is above one thing."""
    return [(name, than) for name in greater]


CLAIMS = (
    Claim("MRR is best with 4 indicators", "5.3", "best number of indicators", ISI),
    Claim(
        "More indicators need fewer epochs (fewer with most than with one)",
        "5.3",
        FEWER_WITH_MORE,
        ISI,
        each(ISI, 0.0),
    ),
    Claim(
        "ISI answers better than Xavier right after insertion (gain, %)",
        "6.1",
        "gain over Xavier (%)",
        ISI,
        each(ISI, 0.0),
    ),
    Claim(
        "The gain comes from semantics (% of it beyond Mean: above 0, above 50)",
        "6.1",
        BEYOND_THE_CENTRE,
        ISI,
        [*each(ISI, 0.0), *each(ISI, 50.0)],
    ),
    Claim(
        "ISI needs fewer epochs than Xavier (%)",
        "6.2",
        "fewer epochs than Xavier (%)",
        (*ISI, "mean of ISI"),
        each((*ISI, "mean of ISI"), 0.0),
    ),
    Claim(
        "Xavier needs more epochs than IU, and IU more than ISI",
        "Table 2",
        "epochs to convergence",
        ("Xavier", "IU", *ISI),
        [("Xavier", "IU"), *(("IU", name) for name in ISI)],
    ),
    Claim(
        "After transfer, ISI answers better than Xavier (MRR, weighted)",
        "6.3",
        "transfer: weighted",
        ("Xavier", *ISI),
        each(ISI, "Xavier"),
    ),
    Claim(
        "About the new entities, ISI answers better than IU (MRR)",
        "6.3",
        "transfer: novel entities",
        ("IU", *ISI),
        each(ISI, "IU"),
    ),
    Claim(
        "Only Xavier needs epochs after transfer",
        "6.3",
        "transfer: epochs to convergence",
        ("IU", *ISI),
    ),
    Claim(
        "Xavier takes from earlier knowledge (drop of MRR, %)",
        "6.3",
        "transfer: drop (%)",
        ("Xavier",),
        each(("Xavier",), 0.0),
    ),
    Claim(
        "ISI names more affordances than Xavier (of 12 answers)",
        "Table 3",
        RIGHT,
        ("Xavier", *ISI),
        each(ISI, "Xavier"),
    ),
)


@table("report")
def claims(results: Results) -> pd.DataFrame | None:
    """The paper's claims with its numbers, ours on both graphs, and a verdict on the first."""
    parts = [paper_results(results)]
    for statistic, frame, extended in (
        (fewer_with_more, sensitivity(results), False),
        (beyond_the_centre, gains(results), False),
        (right_answers, table3_affordances(results), True),
    ):
        titles = [getattr(results.on(papers, extended), "title", "") for papers in (True, False)]
        if frame is not None:
            both = [statistic(frame[frame["graph"] == title]) for title in titles]
            parts.append(side_by_side(*both))
    frame = pd.concat(parts, ignore_index=True)
    printed = results.paper["affordances"]
    theirs = frame["whose"].map({"Xavier": printed["xavier"], **dict.fromkeys(ISI, printed["isi"])})
    return judged(frame.assign(paper=frame["paper"].where(frame["kind"] != RIGHT, theirs)))


def judged(results: pd.DataFrame) -> pd.DataFrame | None:
    """A row for each claim all of whose results are there on the paper's graph; ``results``: as
    rows of ``paper_results``.
    """
    rows = list[TableRow]()
    for claim in CLAIMS:
        of_kind = results[results["kind"] == claim.kind].set_index("whose")
        of_kind = of_kind.reindex(list(claim.whose))
        if of_kind["ours"].isna().any():
            continue
        checks = checked(of_kind, claim.order)
        row: TableRow = {"claim": claim.claim, "where": claim.place}
        row["whose"] = ", ".join(claim.whose)
        row["paper"] = written(of_kind["paper"])
        row["the paper's graph"] = written(of_kind["ours"])
        row["today's graph"] = written(of_kind["today's graph"])
        row["holds"] = f"{sum(checks)} of {len(checks)}"
        rows.append(row | {"verdict": verdict(checks)})
    return pd.DataFrame(rows) if rows else None


def checked(of_kind: pd.DataFrame, order: Sequence[tuple[str, str | float]]) -> list[bool]:
    """Whether each pair has the paper's order, with intervals that do not overlap, and whether each
    number of the paper lies within our interval, in either form.
    """
    low, high = of_kind["ours low"], of_kind["ours high"]
    ordered = [
        bool(low[greater] > (high[than] if isinstance(than, str) else than))
        for greater, than in order
    ]
    printed = of_kind[of_kind["inside"].isin(["yes", "no"])]
    inside = (printed["inside"] == "yes") | (printed["inside in it"] == "yes")
    return ordered + inside.tolist()


def verdict(checks: Sequence[bool]) -> str:
    """``repeated`` if all hold, ``not`` if none does, else ``partly``."""
    if all(checks):
        return "repeated"
    return "partly" if any(checks) else "not"


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


def beyond_the_centre(gained: pd.DataFrame) -> pd.DataFrame:
    """The part of the gain of ES, RS and ERS that Mean lacks, with the bounds of both gains; null
    where there is no gain.
    """
    columns = [f"gain, %{end}" for end in ENDS]
    by_name = gained.set_index("initializer")[columns].reindex([*ISI, "Mean"])
    gain, mean = by_name.loc[list(ISI)], by_name.loc["Mean"]
    gain = gain.where(gain[columns[1]] > 0)
    parts = {
        "ours": mean[columns[0]] / gain[columns[0]],
        "ours low": mean[columns[2]] / gain[columns[1]],
        "ours high": mean[columns[1]] / gain[columns[2]],
    }
    return (100 * (1 - pd.DataFrame(parts))).assign(kind=BEYOND_THE_CENTRE)


def fewer_with_more(swept: pd.DataFrame) -> pd.DataFrame:
    """Epochs with the fewest indicators minus those with the most, with the bounds of both."""
    columns = [f"epochs{end}" for end in ENDS]
    groups = swept.groupby("initializer")[columns]
    few, many = groups.first().reindex(ISI), groups.last().reindex(ISI)
    parts = {
        "ours": few[columns[0]] - many[columns[0]],
        "ours low": few[columns[1]] - many[columns[2]],
        "ours high": few[columns[2]] - many[columns[1]],
    }
    return pd.DataFrame(parts).assign(kind=FEWER_WITH_MORE)


def right_answers(answers: pd.DataFrame) -> pd.DataFrame:
    """The number of answers of the right kind among the first ones about all entities; a count has
    no interval.
    """
    names = [name for name in ("Xavier", *ISI) if name in answers and answers[name].notna().any()]
    rights = {name: (~answers[name].str.startswith("×")).sum() for name in names}
    counts = pd.Series(rights, dtype=float)
    bounds = dict.fromkeys((f"ours{end}" for end in ENDS), counts)
    return pd.DataFrame(bounds).reindex(["Xavier", *ISI]).assign(kind=RIGHT)
