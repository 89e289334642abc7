"""What each figure shows: a function from the table of a figure to its panels."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import pandas as pd

from isi.evaluation.scopes import SCOPES
from stages.report.charts import Panel, bars, dots, lines, places

#: Initializers that lines name; others are in the tables.
MAIN = ["Xavier", "IU", "ES", "RS", "ERS", "Mean", "MAP", "Joint"]


def titled(graph: Any, about: str) -> str:
    """The title of a panel of one graph."""
    name = str(graph)
    return f"{name[:1].upper()}{name[1:]}: {about}"


def by_graph(frame: pd.DataFrame) -> Iterator[tuple[Any, pd.DataFrame]]:
    """The rows of each graph, in order."""
    yield from frame.groupby("graph", sort=False)


def answer(frame: pd.DataFrame) -> list[Panel]:
    """The parts of the gain on each graph, in both groups together and about novel entities."""
    groups = frame.groupby(["scope", "graph"], sort=False)
    ordered = sorted(groups, key=_scope_first)
    return [bars(rows, titled(graph, SCOPES[str(scope)])) for (scope, graph), rows in ordered]


def _scope_first(group: tuple[Any, Any]) -> int:
    (scope, _), _ = group
    return list(SCOPES).index(scope)


def figure3a(frame: pd.DataFrame) -> list[Panel]:
    """The measure by number of novel entities, on each graph: weighted, then by group."""
    shown = frame[frame["model"].isin(MAIN)]
    made = list[Panel]()
    for scope in ("weighted", "novel", "known"):
        for graph, rows in by_graph(shown[shown["scope"] == scope]):
            made.append(lines(rows, "size", "MRR", titled(graph, SCOPES[str(scope)])))
    return made


def directions(frame: pd.DataFrame) -> list[Panel]:
    """Entity prediction with the novel entity as the question, and as the answer."""
    made = list[Panel]()
    for column in ("novel entity given", "novel entity is the answer"):
        for graph, rows in by_graph(frame):
            ordered = rows.sort_values("novel entity given", ascending=False)
            xlabel = "entity prediction, MRR (points)"
            made.append(
                dots(ordered, "model", {column: column}, titled(graph, column), xlabel=xlabel)
            )
    return made


def _curves(frame: pd.DataFrame, scopes: Sequence[str], y: str) -> list[Panel]:
    """Panels by epoch for each scope and graph; dotted: the joint model, in MRR."""
    shown, made = frame[frame["model"].isin([*MAIN, "Nothing inserted"])], list[Panel]()
    for scope in scopes:
        for graph, rows in by_graph(shown[shown["scope"] == scope].dropna(subset=y)):
            joint, drawn = rows[rows["model"] == "Joint"], rows[rows["model"] != "Joint"]
            level = ("Joint", float(joint[y].mean())) if y == "MRR" else None
            ylabel = "MRR (points)" if y == "MRR" else "change of MRR (points)"
            title = titled(graph, SCOPES[str(scope)])
            made.append(lines(drawn, "epoch", y, title, ylabel=ylabel, level=level))
    return made


def figure3b(frame: pd.DataFrame) -> list[Panel]:
    """Learning curves: both groups together, then about novel entities."""
    return _curves(frame, ("weighted", "novel"), "MRR")


def forgetting(frame: pd.DataFrame) -> list[Panel]:
    """The change of earlier knowledge since before the insertion."""
    return _curves(frame, ("known", "known_closed"), "change")


def figure4(frame: pd.DataFrame) -> list[Panel]:
    """Earlier knowledge during the transfer."""
    return _curves(frame, ("known",), "MRR")


def sensitivity(frame: pd.DataFrame) -> list[Panel]:
    """Figure 2a: the measure right after insertion by number of indicators."""
    return [
        lines(rows, "indicators", "weighted: MRR", titled(graph, SCOPES["weighted"]))
        for graph, rows in by_graph(frame)
    ]


def sensitivity_of_epochs(frame: pd.DataFrame) -> list[Panel]:
    """Figure 2b: epochs to convergence by number of indicators."""
    return [
        lines(rows, "indicators", "epochs", titled(graph, "epochs"), ylabel="epochs")
        for graph, rows in by_graph(frame)
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
    """The paper's results and ours: a panel for each kind."""
    columns = {"the paper": "paper", "its graph": "ours", "today's graph": "today's graph"}
    return [
        dots(rows, "whose", columns, str(kind), xlabel="")
        for kind, rows in frame.groupby("kind", sort=False)
    ]


def by_row(frame: pd.DataFrame, row: str, columns: Mapping[str, str], title: str) -> Panel:
    """Entity prediction with the novel entity given: a row for each model or graph, a mark for each
    of some columns.
    """
    shown = {name: column for name, column in columns.items() if column in frame}
    return dots(frame, row, shown, title, xlabel="entity MRR, novel entity given (points)")


#: Initializers of figures with a row for each graph.
_FEW = {name: name for name in ("Xavier", "Mean", "ERS", "MAP", "Joint")}


def insert_triples(frame: pd.DataFrame) -> list[Panel]:
    """Entity MRR by the number of insert triples."""
    columns = {name: name for name in ("ES", "ERS", "MAP")}
    return [by_row(frame, "insert triples", columns, "Number of insert triples")]


def embeddings(frame: pd.DataFrame) -> list[Panel]:
    """Entity MRR by embedding model, a panel for each graph."""
    return [
        by_row(rows, "embedding", _FEW, str(graph))
        for graph, rows in frame.groupby("graph", sort=False)
    ]


def graphs(frame: pd.DataFrame) -> list[Panel]:
    """Entity MRR on every graph."""
    return [by_row(frame, "graph", _FEW, "Graphs")]


def strong(frame: pd.DataFrame) -> list[Panel]:
    """All initializers, sorted by entity MRR with the novel entity given."""
    column = "novel entity given"
    ordered = frame.sort_values(column, ascending=False)
    return [by_row(ordered, "model", {"": column}, "Initializers")]
