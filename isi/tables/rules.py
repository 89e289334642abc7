"""What the rows of a table must hold: rules, and the first row that breaks one."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd

#: Characters of a name, and of a value that a message repeats, at most.
LONGEST, SHOWN = 1000, 40
#: Observations of a table, at most: training passes over all of them in every epoch.
MOST_OBSERVED = 10**9
#: By how much single-precision means may leave where they should be.
ROUNDING = 1e-6


@dataclass(frozen=True)
class Rule:
    """What every row must hold."""

    #: what is expected
    says: str
    #: whose values a message shows of a row that breaks it
    columns: Sequence[str]
    #: rows of a table that break it; shape: (rows,), bool
    broken: Callable[[pd.DataFrame], np.ndarray]


def first_breach(frame: pd.DataFrame, rules: Iterable[Rule]) -> tuple[str, str] | None:
    """Of the first rule that is broken: the place of the first row that breaks it, and what was expected."""
    for rule in rules:
        broken = rule.broken(frame)
        if broken.any():
            return place_of(frame, int(broken.argmax()), rule.columns), rule.says
    return None


def place_of(frame: pd.DataFrame, row: int, columns: Iterable[str]) -> str:
    """A row by its number, from 0 as ids are, and by some of its values."""
    return f"row {row} ({', '.join(f'{name} {shown(frame[name].iloc[row])}' for name in columns)})"


def shown(value: object) -> str:
    """A value as a message repeats it: cut where it is long."""
    text = "null" if pd.isna(value) else repr(value) if isinstance(value, str) else str(value)  # type: ignore[call-overload]
    return text if len(text) <= SHOWN else f"{text[:SHOWN]}…"


def present(*columns: str) -> list[Rule]:
    """No value is null."""
    return [_of(name, f"expected a value in column {name!r}", _null) for name in columns]


def at_least(low: float, *columns: str) -> list[Rule]:
    """No number lies below; null is none."""
    return [_of(name, f"expected {name!r} from {low:g} on", lambda values: _numbers(values) < low) for name in columns]


def within(low: float, high: float, *columns: str) -> list[Rule]:
    """Numbers lie in an interval; null is none."""

    def outside(values: pd.Series) -> np.ndarray:
        numbers = _numbers(values)
        return (numbers < low - ROUNDING) | (numbers > high + ROUNDING)

    return [_of(name, f"expected {name!r} from {low:g} to {high:g}", outside) for name in columns]


def finite(*columns: str) -> list[Rule]:
    """Numbers are not infinite; null is none."""
    return [_of(name, f"expected {name!r} to be finite", lambda values: np.isinf(_numbers(values))) for name in columns]


def one_of(column: str, names: Collection[str]) -> list[Rule]:
    """Text is of a list; null is none."""
    says = f"expected {column!r} among {', '.join(names)}"
    return [_of(column, says, lambda values: _such(values, lambda name: name not in names))]


def named(*columns: str) -> list[Rule]:
    """Text is a name: not blank, not longer than ``LONGEST``, without control characters; null is none."""

    def is_none(name: str) -> bool:
        return not name.strip() or len(name) > LONGEST or any(ord(one) < 32 or ord(one) == 127 for one in name)

    says = f"a name, not blank, of {LONGEST:,} characters at most and no control character"
    return [_of(name, f"expected {name!r} to be {says}", lambda values: _such(values, is_none)) for name in columns]


def unique(*key: str) -> list[Rule]:
    """No two rows are the same in these columns."""
    says = f"expected no second row of the same {', '.join(key)}"
    return [Rule(says, key, lambda frame: frame.duplicated(list(key)).to_numpy())]


def ascending(*key: str) -> list[Rule]:
    """Rows stand in the order of these columns, text in that of its code points, and no two are the same in them."""
    says = f"expected rows in ascending order of {', '.join(key)}, each once"
    return [Rule(says, key, lambda frame: _not_behind([_ranks(frame[name]) for name in key]))]


def in_blocks(block: str, *key: str) -> list[Rule]:
    """Rows of one value of a column stand together, and those of each ascend (see ``ascending``)."""
    says = f"expected rows of each {block} together, in ascending order of {', '.join(key)}"

    def broken(frame: pd.DataFrame) -> np.ndarray:
        return _not_behind([pd.factorize(frame[block])[0], *(_ranks(frame[name]) for name in key)])

    return [Rule(says, (block, *key), broken)]


def counted(column: str = "count") -> list[Rule]:
    """Numbers of observations: each from 1 on, and ``MOST_OBSERVED`` altogether."""
    says = f"expected {MOST_OBSERVED:,} observations at most, altogether"
    return [*at_least(1, column), _of(column, says, lambda values: np.cumsum(_numbers(values)) > MOST_OBSERVED)]


def measured(measures: Sequence[str], queries: str) -> list[Rule]:
    """Measures in [0, 1], null where there are no queries and nowhere else."""
    says = f"expected null where {queries!r} is 0, and nowhere else"

    def broken(name: str) -> Rule:
        return Rule(says, (name, queries), lambda frame: _null(frame[name]) != (_numbers(frame[queries]) == 0))

    return [*at_least(0, queries), *within(0, 1, *measures), *map(broken, measures)]


def mean_of(whole: str, *halves: str) -> list[Rule]:
    """A number is the mean of others; null is none."""

    def broken(frame: pd.DataFrame) -> np.ndarray:
        mean = frame[list(halves)].to_numpy(np.float64).mean(1)
        return np.asarray(np.abs(_numbers(frame[whole]) - mean) > ROUNDING)

    return [Rule(f"expected {whole!r} to be the mean of {' and '.join(halves)}", (whole, *halves), broken)]


def not_above(lesser: str, greater: str) -> list[Rule]:
    """A number is not above another."""
    says = f"expected {lesser!r} not above {greater!r}"
    return [Rule(says, (lesser, greater), lambda frame: _numbers(frame[lesser]) > _numbers(frame[greater]))]


def first_not_finite(numbers: np.ndarray) -> tuple[int, ...] | None:
    """The place of the first number that is none, or infinite."""
    finite = np.isfinite(numbers)
    return None if finite.all() else tuple(int(at) for at in np.unravel_index(int(finite.argmin()), numbers.shape))


def _of(column: str, says: str, broken: Callable[[pd.Series], np.ndarray]) -> Rule:
    """A rule about one column."""
    return Rule(says, (column,), lambda frame: broken(frame[column]))


def _null(values: pd.Series) -> np.ndarray:
    return values.isna().to_numpy()


def _numbers(values: pd.Series) -> np.ndarray:
    """Numbers, of which null is not one: it is neither above nor below any other."""
    return values.to_numpy()


def _such(values: pd.Series, is_such: Callable[[str], bool]) -> np.ndarray:
    """Rows with such text; each text is looked at once."""
    found = [name for name in values.dropna().unique() if is_such(name)]
    return values.isin(found).to_numpy() if found else np.zeros(len(values), dtype=bool)


def _not_behind(columns: Sequence[np.ndarray]) -> np.ndarray:
    """Rows that do not come behind the one before them, in the order of these columns."""
    rows = len(columns[0])
    behind, tied = np.zeros(max(rows - 1, 0), dtype=bool), np.ones(max(rows - 1, 0), dtype=bool)
    for values in columns:
        behind |= tied & (values[1:] > values[:-1])
        tied &= values[1:] == values[:-1]
    return np.concatenate([np.zeros(min(rows, 1), dtype=bool), ~behind])


def _ranks(values: pd.Series) -> np.ndarray:
    """Numbers in the order of the values; null comes first."""
    if values.dtype.kind in "biuf":
        return values.to_numpy()
    codes, names = pd.factorize(values)
    rank = np.full(len(names) + 1, -1)
    rank[sorted(range(len(names)), key=lambda place: str(names[place]))] = np.arange(len(names))
    return rank[codes]
