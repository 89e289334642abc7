"""What each figure shows: a function from the table of a figure to its panels.

Models are in the order of their table. An initializer of your own is in every figure of models.
"""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import pandas as pd

from stages.report.charts import DENSE, PALETTE, Panel, bars, dots, lines
from stages.report.scopes import DIRECTIONS, GROUPED, TITLES
from stages.report.tables.forms import estimates, is_number


def with_lines(frame: pd.DataFrame) -> pd.DataFrame:
    """The rows of models that have a line: all but those that ``palette.yaml`` leaves to tables."""
    return frame[~frame["model"].isin(PALETTE["without_line"])]


def titled(graph: Any, about: str) -> str:
    """The title of a panel of one graph."""
    name = str(graph)
    return f"{name[:1].upper()}{name[1:]}: {about}"


def by_graph(frame: pd.DataFrame) -> Iterator[tuple[Any, pd.DataFrame]]:
    """The rows of each graph, in order."""
    yield from frame.groupby("graph", sort=False)


def answer(frame: pd.DataFrame) -> list[Panel]:
    """The parts of the gain on each graph, in both groups together and about novel entities."""
    panels = list[Panel]()
    for scope in GROUPED:
        of_scope = frame[frame["scope"] == scope]
        panels += [bars(rows, titled(graph, TITLES[scope])) for graph, rows in by_graph(of_scope)]
    return panels


def figure3a(frame: pd.DataFrame) -> list[Panel]:
    """The measure by number of novel entities, on each graph: weighted, then by group."""
    shown = with_lines(frame)
    panels = list[Panel]()
    for scope in ("weighted", "novel", "known"):
        of_scope = shown[shown["scope"] == scope]
        for graph, rows in by_graph(of_scope):
            panels.append(lines(rows, "size", "MRR", titled(graph, TITLES[scope])))
    return panels


def _curves(frame: pd.DataFrame, scope: str) -> list[Panel]:
    """A panel by epoch for each graph; dotted: the joint model. After ``DENSE``, where the axis is
    logarithmic, each tenth epoch is drawn.
    """
    shown = with_lines(frame).dropna(subset="MRR")
    shown = shown[shown["scope"] == scope]
    shown = shown[(shown["epoch"] <= DENSE) | (shown["epoch"] % 10 == 0)]
    panels = list[Panel]()
    for graph, rows in by_graph(shown):
        is_joint = rows["model"] == "Joint"
        level = ("Joint", float(rows.loc[is_joint, "MRR"].mean()))
        title = titled(graph, TITLES[scope])
        panels.append(lines(rows[~is_joint], "epoch", "MRR", title, level=level))
    return panels


def figure3b(frame: pd.DataFrame) -> list[Panel]:
    """Learning curves of both groups together."""
    return _curves(frame, "weighted")


def figure4(frame: pd.DataFrame) -> list[Panel]:
    """Earlier knowledge during the transfer."""
    return _curves(frame, "known")


def sensitivity(frame: pd.DataFrame) -> list[Panel]:
    """Figure 2a: the measure right after insertion by number of indicators."""
    return [
        lines(rows, "indicators", "weighted: MRR", titled(graph, TITLES["weighted"]))
        for graph, rows in by_graph(frame)
    ]


def sensitivity_of_epochs(frame: pd.DataFrame) -> list[Panel]:
    """Figure 2b: epochs to convergence by number of indicators."""
    return [
        lines(rows, "indicators", "epochs", titled(graph, "epochs"), ylabel="epochs")
        for graph, rows in by_graph(frame)
    ]


#: Models of figures with a row for each graph.
_FEW = ("Xavier", "Mean", "ERS", "MAP", "Joint")


def by_row(frame: pd.DataFrame, row: str, models: Sequence[str], title: str) -> Panel:
    """Entity prediction with the novel entity given: a row for each model or graph, a mark for each
    of some models and for each that the palette does not name.
    """
    numbers = [name for name in estimates(frame) if is_number(frame[name])]
    unnamed = [name for name in numbers if name not in PALETTE["models"]]
    marked = [name for name in models if name in frame] + unnamed
    return entity_prediction(frame, row, dict(zip(marked, marked, strict=True)), title)


def entity_prediction(
    frame: pd.DataFrame, row: str, columns: Mapping[str, str], title: str
) -> Panel:
    """A mark for each of some columns (title to column) of entity MRR, a row for each ``row``."""
    return dots(frame, row, columns, title, xlabel="entity MRR, novel entity given (points)")


def insert_triples(frame: pd.DataFrame) -> list[Panel]:
    """Entity MRR by the number of insert triples."""
    return [by_row(frame, "insert triples", ("ES", "ERS", "MAP"), "Number of insert triples")]


def embeddings(frame: pd.DataFrame) -> list[Panel]:
    """Entity MRR by embedding model, a panel for each graph."""
    return [by_row(rows, "embedding", _FEW, str(graph)) for graph, rows in by_graph(frame)]


def graphs(frame: pd.DataFrame) -> list[Panel]:
    """Entity MRR on every graph."""
    return [by_row(frame, "graph", _FEW, "Graphs")]


def strong(frame: pd.DataFrame) -> list[Panel]:
    """All initializers, sorted by entity MRR with the novel entity given."""
    column = DIRECTIONS["given"]
    ordered = frame.sort_values(column, ascending=False)
    return [entity_prediction(ordered, "model", {"": column}, "Initializers")]
