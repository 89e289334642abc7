"""What each figure shows: a function from the table of a figure to its panels."""

from collections.abc import Mapping

import pandas as pd

from isi.report.charts import Panel, bars, dots, lines, places, scatter

#: Titles of scopes.
SCOPES = {
    "all": "All queries",
    "novel": "Novel entities",
    "novel_heldout": "Novel entities, held-out triples",
    "given": "Novel entity given",
    "known": "Earlier knowledge",
    "known_closed": "Earlier knowledge, known candidates",
}
#: Initializers that lines and points name; others are in the tables.
MAIN = ["Xavier", "IU", "ES", "RS", "ERS", "Mean", "MAP", "Joint"]


def answer(frame: pd.DataFrame) -> list[Panel]:
    """The parts of the gain, over all queries and about novel entities."""
    return [bars(rows, SCOPES[str(scope)]) for scope, rows in frame.groupby("scope", sort=False)]


def figure3a(frame: pd.DataFrame) -> list[Panel]:
    """MRR* by number of novel entities: over all queries and about them; then entity prediction."""
    shown = frame[frame["model"].isin(MAIN)]
    titles = {"MRR*": "MRR*", "entity half": "entity prediction"}
    return [
        lines(shown[shown["scope"] == scope], "size", measure, f"{SCOPES[scope]}: {title}")
        for measure, title in titles.items()
        for scope in ("all", "novel")
    ]


def directions(frame: pd.DataFrame) -> list[Panel]:
    """Entity MRR* with the novel entity as the question, and as the answer."""
    ordered = frame.sort_values("novel entity given", ascending=False)
    titles = {
        "novel entity given": "The novel entity is given",
        "novel entity is the answer": "The novel entity is the answer",
    }
    xlabel = "entity MRR* (points), 95 % interval"
    return [
        dots(ordered, "model", {title: column}, title, xlabel=xlabel)
        for column, title in titles.items()
    ]


def gain_and_cost(frame: pd.DataFrame) -> list[Panel]:
    """What is answered about novel entities against what earlier knowledge loses."""
    shown = frame[frame["initializer"].isin([*MAIN, "Kind mean", "Soft hybrid"])]
    return [
        scatter(
            shown,
            "earlier knowledge loses",
            "MRR* about novel entities",
            "initializer",
            "Gain and cost",
            xlabel="earlier knowledge loses (points of MRR*)",
            ylabel="MRR* about novel entities (points)",
        )
    ]


def _curves(
    frame: pd.DataFrame, scopes: Mapping[str, str], y: str, with_margin: bool = False
) -> list[Panel]:
    shown = frame[frame["model"].isin([*MAIN, "Nothing inserted"])]
    made = list[Panel]()
    for scope, title in scopes.items():
        rows = shown[shown["scope"] == scope].dropna(subset=y)
        joint = rows[rows["model"] == "Joint"]
        level = ("margin", (joint[y] - joint["margin"]).mean()) if with_margin else None
        drawn = rows[rows["model"] != "Joint"]
        ylabel = "MRR* (points)" if y == "MRR*" else "change of MRR* (points)"
        made.append(lines(drawn, "epoch", y, title, ylabel=ylabel, level=level))
    return made


def figure3b(frame: pd.DataFrame) -> list[Panel]:
    """Learning curves: all queries, and held-out queries about novel entities."""
    scopes = {scope: SCOPES[scope] for scope in ("all", "novel_heldout")}
    return _curves(frame, scopes, "MRR*", with_margin=True)


def forgetting(frame: pd.DataFrame) -> list[Panel]:
    """The change of earlier knowledge since before the insertion."""
    scopes = {scope: SCOPES[scope] for scope in ("known", "known_closed")}
    return _curves(frame, scopes, "change")


def figure4(frame: pd.DataFrame) -> list[Panel]:
    """Earlier knowledge during the transfer: MRR*, and its change with known candidates alone."""
    first = _curves(frame, {"known": SCOPES["known"]}, "MRR*")
    return first + _curves(frame, {"known_closed": SCOPES["known_closed"]}, "change")


def sensitivity(frame: pd.DataFrame) -> list[Panel]:
    """Figure 2a: MRR* right after insertion by number of indicators."""
    return _by_indicators(frame, "MRR*", ("all", "novel"), "MRR* (points)")


def sensitivity_of_epochs(frame: pd.DataFrame) -> list[Panel]:
    """Figure 2b: epochs to convergence by number of indicators."""
    return _by_indicators(frame, "epochs", ("all", "novel_heldout"), "epochs to convergence")


def _by_indicators(
    frame: pd.DataFrame, measure: str, scopes: tuple[str, ...], ylabel: str
) -> list[Panel]:
    return [
        lines(frame, "indicators", f"{scope}: {measure}", SCOPES[scope], ylabel=ylabel)
        for scope in scopes
    ]


def figure1(frame: pd.DataFrame) -> list[Panel]:
    """The path of one entity: each initializer of ISI with its indicators, then the others."""
    known = frame[frame["what"] == "known entity"]
    mean = float(known["distance"].mean())
    with_indicators = list(dict.fromkeys(frame.loc[frame["what"] == "indicator", "initializer"]))
    others = frame[~frame["initializer"].isin(with_indicators)]
    made = [
        places(pd.concat([known, frame[frame["initializer"] == name]]), name, mean)
        for name in with_indicators
    ]
    return [*made, places(others, "Other initializers", mean)]


def paper_results(frame: pd.DataFrame) -> list[Panel]:
    """The paper's results beside this run's: a panel for each kind."""
    made = list[Panel]()
    columns = {"the paper": "paper", "this run": "this run"}
    for kind, rows in frame.groupby("kind", sort=False):
        made.append(dots(rows, "whose", columns, str(kind), xlabel="", left=90))
    return made


def by_row(frame: pd.DataFrame, row: str, columns: Mapping[str, str], title: str) -> Panel:
    """Entity MRR* with the novel entity given: a row for each model or graph, a mark for each of
    some columns.
    """
    shown = {name: column for name, column in columns.items() if column in frame}
    return dots(frame, row, shown, title, xlabel="entity MRR*, novel entity given (points)")


#: Initializers of figures with a row for each graph.
_FEW = {name: name for name in ("Xavier", "Mean", "ERS", "MAP", "Joint")}


def insert_triples(frame: pd.DataFrame) -> list[Panel]:
    """Entity MRR* by the number of insert triples."""
    columns = {name: name for name in ("ES", "ERS", "MAP")}
    return [by_row(frame, "insert triples", columns, "Number of insert triples")]


def embeddings(frame: pd.DataFrame) -> list[Panel]:
    """Entity MRR* by embedding model, a panel for each graph."""
    return [
        by_row(rows, "embedding", _FEW, str(graph))
        for graph, rows in frame.groupby("graph", sort=False)
    ]


def graphs(frame: pd.DataFrame) -> list[Panel]:
    """Entity MRR* on every graph."""
    return [by_row(frame, "graph", _FEW, "Graphs")]


def strong(frame: pd.DataFrame) -> list[Panel]:
    """All initializers, sorted by entity MRR* with the novel entity given."""
    column = "novel entity given"
    ordered = frame.sort_values(column, ascending=False)
    return [by_row(ordered, "model", {"": column}, "Initializers")]
