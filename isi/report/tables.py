"""Estimates and tables as values: sections return them, and CSV, Markdown,
LaTeX and the page are written from them.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from math import isnan, nan
from typing import Any, Self

import numpy as np
import pandas as pd

#: In files: decimals of points, epochs and per cent; significant digits of numbers of any size.
DECIMALS, DIGITS = 2, 4
Form = Callable[[float], str]
Rows = list[dict[Any, Any]]  #: Rows of a table: cells by column.
Cells = dict[Any, list[Any]]  #: Columns of a table.


@dataclass(frozen=True)
class Estimate:
    """A mean and the bounds of its 95 % interval; NaN if there is none."""

    mean: float
    low: float = nan
    high: float = nan

    def __format__(self, spec: str) -> str:
        """The mean, then the interval, if there is one, in brackets;
        ``spec`` formats each number.
        """
        interval = "" if isnan(self.low) else f" [{self.low:{spec}}, {self.high:{spec}}]"
        return f"{self.mean:{spec}}{interval}"

    @property
    def parts(self) -> tuple[float, float, float]:
        return self.mean, self.low, self.high


@dataclass(frozen=True)
class Column:
    """A column of a table: its names, and the format of its cells."""

    name: str
    #: a header above it and its neighbours
    group: str = ""
    #: header on the page; default: the name, or its entry in ``words.WORDS``
    title: str = field(default="", compare=False)
    #: format of numbers as shown; default: one decimal, or none if all are whole
    form: Form | None = field(default=None, compare=False)
    #: the page's words for texts in cells
    words: Mapping[str, str] = field(default_factory=dict, compare=False)
    #: whether the page shows its cells small and grey below those of the column before it
    below: bool = field(default=False, compare=False)
    #: whether files round its numbers to ``DIGITS`` significant digits, not to ``DECIMALS``
    any_size: bool = field(default=False, compare=False)

    @property
    def header(self) -> str:
        """The header of the column in files."""
        return f"{self.group}: {self.name}" if self.group else self.name


@dataclass(frozen=True, eq=False)
class ReportTable:
    """Rows of cells under typed columns; a cell is an estimate, a number, a text or null."""

    name: str
    columns: Sequence[Column]
    rows: Sequence[Sequence[Any]]

    @classmethod
    def of(
        cls, name: str, rows: pd.DataFrame | Mapping[Any, Any] | Iterable[Mapping[Any, Any]]
    ) -> Self:
        """A table from a frame, a mapping of columns or an iterable of rows;
        labels are of type ``Column`` or text.
        """
        if isinstance(rows, Mapping):
            cells = [dict(zip(rows, row, strict=True)) for row in zip(*rows.values(), strict=True)]
            rows = pd.DataFrame(cells, columns=list(rows))
        frame = rows if isinstance(rows, pd.DataFrame) else pd.DataFrame(list(rows))
        labels: list[Any] = list(frame.columns)
        columns = [label if isinstance(label, Column) else Column(label) for label in labels]
        return cls(name, columns, frame.astype(object).to_numpy().tolist())

    @property
    def by_column(self) -> list[tuple[Column, list[Any]]]:
        """The columns with their cells."""
        return [
            (column, [row[place] for row in self.rows]) for place, column in enumerate(self.columns)
        ]

    @property
    def frame(self) -> pd.DataFrame:
        """The table for CSV: a column of estimates becomes three, with the mean and the bounds."""
        values: dict[str, Any] = {}
        for column, cells in self.by_column:
            if any(isinstance(cell, Estimate) for cell in cells):
                parts = zip(*map(_numbers, cells), strict=True)
                values |= zip(
                    (f"{column.header}{end}" for end in ("", " low", " high")), parts, strict=True
                )
            else:
                values[column.header] = cells
        return pd.DataFrame(values)

    @property
    def layout(self) -> list[tuple[int, Column, int | None]]:
        """The columns of the page: their place, the column, and the place of the column below it,
        if there is one.
        """
        after = [
            *(place if column.below else None for place, column in enumerate(self.columns)),
            None,
        ]
        return [
            (place, column, after[place + 1])
            for place, column in enumerate(self.columns)
            if not column.below
        ]

    @property
    def is_text(self) -> list[bool]:
        """For each column, whether it holds text; a column with a ``form`` holds numbers."""
        return [
            not column.form and any(isinstance(cell, str) for cell in cells)
            for column, cells in self.by_column
        ]

    @property
    def texts(self) -> list[list[tuple[str, str]]]:
        """For each row, the cells as shown: pairs of a value and its interval in brackets."""
        forms = [column.form or _plain(cells) for column, cells in self.by_column]
        return [
            [
                (cell, "") if isinstance(cell, str) else _shown(_numbers(cell), form)
                for cell, form in zip(row, forms, strict=True)
            ]
            for row in self.rows
        ]

    @property
    def shown(self) -> pd.DataFrame:
        """The table for Markdown and LaTeX: values with their intervals, as text."""
        rows = [[f"{value} {interval}".strip() for value, interval in row] for row in self.texts]
        return pd.DataFrame(rows, columns=[column.header for column in self.columns])

    @property
    def files(self) -> dict[str, str]:
        """The table as CSV, Markdown and LaTeX."""
        sides = ["left" if text else "right" for text in self.is_text]
        markdown = self.shown.to_markdown(
            index=False, disable_numparse=True, colalign=sides if self.rows else None
        )
        latex = self.shown.replace("–", "--").style.hide(axis="index").format(escape="latex")
        latex = latex.format_index(escape="latex", axis=1)
        tex: str = latex.to_latex(hrules=True, column_format="".join(side[0] for side in sides))
        any_size = [column.header for column in self.columns if column.any_size]
        tex = tex.replace("ξ", r"$\xi$").replace("Θ", r"$\Theta$")
        return {"csv": csv(self.frame, any_size), "md": f"{markdown}\n", "tex": tex}


def number(value: Any, any_size: bool = False) -> Any:
    """A float, rounded to the digits on which two types of processor agree;
    other values unchanged.
    """
    if not isinstance(value, float) or isnan(value):
        return value
    if any_size and abs(value) < 10**DIGITS and not float(value).is_integer():
        return float(f"{value:.{DIGITS}g}")
    return round(float(value), DECIMALS) + 0.0  # no -0.0


def csv(frame: pd.DataFrame, any_size: Sequence[str] = ()) -> str:
    """A frame as CSV; columns in ``any_size`` are rounded to significant digits,
    others to decimals.
    """
    rounded = frame.apply(
        lambda column: column.map(lambda value: number(value, column.name in any_size))
    )
    text: str = rounded.to_csv(index=False, float_format="%.10g", lineterminator="\n")
    return text


def _numbers(cell: Any) -> tuple[float, float, float]:
    if isinstance(cell, Estimate):
        return cell.parts
    return (cell if isinstance(cell, float | int) else nan, nan, nan)


def _plain(cells: Iterable[Any]) -> Form:
    """The default format of a column: one decimal, or none if all cells are whole."""
    parts = np.array([_numbers(cell) for cell in cells], dtype=float).round(3) % 1
    digits = 0 if (np.isnan(parts) | (parts == 0)).all() else 1
    return lambda value: f"{round(value, digits) + 0.0:,.{digits}f}"  # no -0.0


def _shown(numbers: tuple[float, float, float], form: Form) -> tuple[str, str]:
    mean, low, high = ("" if isnan(number) else form(number) for number in numbers)
    return mean or "–", f"[{low}, {high}]" if mean and low and high else ""
