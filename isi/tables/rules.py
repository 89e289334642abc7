"""Rules for the rows of tables, and how an error names the row that breaks one."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd

from isi.errors import InputError

#: Characters of a name, and of a value that a message repeats, at most.
LONGEST, SHOWN = 1000, 40
#: Observations of a table, at most: training passes over all of them in every epoch.
MOST_OBSERVED = 10**9
#: Whether rows break a rule; shape: (rows,), bool.
Broken = np.ndarray | pd.Series
#: By how much single-precision means may differ.
ROUNDING = 1e-6


@dataclass(frozen=True)
class Rule:
    """What every row must hold."""

    #: what is expected
    says: str
    #: whose values a message shows of a row that breaks it
    columns: Sequence[str]
    #: of a table
    broken: Callable[[pd.DataFrame], Broken]


def place_of(frame: pd.DataFrame, row: int, columns: Iterable[str]) -> str:
    """How an error names a row: by its number from 0, and its values in some columns."""
    return f"row {row} ({', '.join(f'{name} {_shown(frame[name].iloc[row])}' for name in columns)})"


def refuse(path: object, frame: pd.DataFrame, wrong: Broken, columns: Iterable[str], expected: str) -> None:
    """Raise an InputError that names the first wrong row of a table, if there is one."""
    rows = np.flatnonzero(wrong)
    if len(rows):
        raise InputError(path, place_of(frame, int(rows[0]), columns), expected)


def _shown(value: object) -> str:
    text = "null" if pd.isna(value) else repr(value) if isinstance(value, str) else str(value)  # type: ignore[call-overload]
    return text if len(text) <= SHOWN else f"{text[:SHOWN]}…"


def _each(columns: Iterable[str], says: str, broken: Callable[[pd.Series], Broken]) -> list[Rule]:
    """One rule for each column; ``{}`` in the text becomes the column's name."""

    def of(name: str) -> Rule:
        return Rule(says.format(repr(name)), [name], lambda frame: broken(frame[name]))

    return [of(name) for name in columns]


def present(*columns: str) -> list[Rule]:
    """No value is null."""
    return _each(columns, "expected a value in column {}", pd.Series.isna)


def at_least(low: float, *columns: str) -> list[Rule]:
    """No number is below; null is allowed."""
    return _each(columns, f"expected {{}} of at least {low:g}", lambda values: values < low)


def within(low: float, high: float, *columns: str) -> list[Rule]:
    """Numbers lie in an interval; null is allowed."""
    says = f"expected {{}} from {low:g} to {high:g}"
    return _each(columns, says, lambda values: (values < low - ROUNDING) | (values > high + ROUNDING))


def finite(*columns: str) -> list[Rule]:
    """Numbers are not infinite; null is allowed."""
    return _each(columns, "expected {} to be finite", lambda values: np.isinf(values))


def one_of(column: str, names: Collection[str]) -> list[Rule]:
    """Text is in a list; null is allowed."""
    says = f"expected {{}} among {', '.join(names)}"
    return _each([column], says, lambda values: ~(values.isin(list(names)) | values.isna()))


def named(*columns: str) -> list[Rule]:
    """Text is a name: not blank, not longer than ``LONGEST``, without control characters; null is allowed."""

    def nameless(name: str) -> bool:
        return not name.strip() or len(name) > LONGEST or any(ord(char) < 32 or ord(char) == 127 for char in name)

    says = f"expected {{}} to be a name: not blank, at most {LONGEST:,} characters, no control characters"
    return _each(columns, says, lambda values: values.isin([*filter(nameless, values.dropna().unique())]))


def unique(*key: str) -> list[Rule]:
    """No two rows have the same values in these columns."""
    says = f"expected only one row with the same {', '.join(key)}"
    return [Rule(says, key, lambda frame: frame.duplicated(list(key)))]


def ascending(*key: str) -> list[Rule]:
    """Rows ascend in these columns, text by its code points, and no two have the same values in them."""
    says = f"expected rows in ascending order of {', '.join(key)}, each once"
    return [Rule(says, key, lambda frame: _descending([_ranks(frame[name]) for name in key]))]


def in_blocks(block: str, *key: str) -> list[Rule]:
    """Rows with the same value of a column are adjacent, and ascend within their block (see ``ascending``)."""
    says = f"expected rows of each {block} together, in ascending order of {', '.join(key)}"

    def broken(frame: pd.DataFrame) -> np.ndarray:
        return _descending([pd.factorize(frame[block])[0], *(_ranks(frame[name]) for name in key)])

    return [Rule(says, (block, *key), broken)]


def counted(column: str = "count") -> list[Rule]:
    """Numbers of observations: each at least 1, and at most ``MOST_OBSERVED`` altogether."""
    says = f"expected at most {MOST_OBSERVED:,} observations in all"
    too_many = _each([column], says, lambda values: values.astype(np.int64).cumsum() > MOST_OBSERVED)
    return [*at_least(1, column), *too_many]


def measured(measures: Sequence[str], queries: str) -> list[Rule]:
    """Measures in [0, 1], null where there are no queries and nowhere else."""
    says = f"expected null where {queries!r} is 0, and nowhere else"

    def broken(name: str) -> Rule:
        return Rule(says, (name, queries), lambda frame: frame[name].isna() != (frame[queries] == 0))

    return [*at_least(0, queries), *within(0, 1, *measures), *map(broken, measures)]


def mean_of(whole: str, *halves: str) -> list[Rule]:
    """A number is the mean of others; null is allowed."""

    def broken(frame: pd.DataFrame) -> np.ndarray:
        mean = frame[list(halves)].to_numpy(np.float64).mean(1)
        return np.asarray(np.abs(frame[whole].to_numpy(np.float64) - mean) > ROUNDING)

    return [Rule(f"expected {whole!r} to be the mean of {' and '.join(halves)}", (whole, *halves), broken)]


def not_above(lesser: str, greater: str) -> list[Rule]:
    """A number is not above another."""
    says = f"expected {lesser!r} to be at most {greater!r}"
    return [Rule(says, (lesser, greater), lambda frame: frame[lesser] > frame[greater])]


def _descending(columns: Sequence[np.ndarray]) -> np.ndarray:
    """Rows that are not above the row before in the order of these columns; shape: (rows,), bool."""
    steps = np.stack([np.sign(np.diff(values)) for values in columns])
    first = np.take_along_axis(steps, (steps != 0).argmax(0)[None], 0)[0]
    return np.concatenate([np.zeros(min(len(columns[0]), 1), dtype=bool), ~(first > 0)])


def _ranks(values: pd.Series) -> np.ndarray:
    """Integers in the same order as the values; null is lowest."""
    return values.to_numpy() if values.dtype.kind in "biuf" else pd.factorize(values.astype(object), sort=True)[0]
