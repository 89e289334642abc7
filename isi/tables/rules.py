"""Types of columns, rules for the rows of tables, and the error that names the first wrong row."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Literal, TypeAlias

import numpy as np

from isi.errors import InputError

if TYPE_CHECKING:  # few commands need pandas, whose import takes 0.4 s
    import pandas as pd

LONGEST, SHOWN = 1000, 40  #: Maximum number of characters of a name, and of a value in a message.
#: Maximum sum of the counts of a table: an epoch passes over all observations.
MOST_OBSERVED = 10**9
ROUNDING = 1e-6  #: Tolerance for means, which are computed in single precision.
#: Arrow's type of a column by name; ``category``: text that repeats, dictionary-encoded.
ArrowType = Literal["bool", "int32", "int64", "float64", "string", "category"]
#: Whether each row breaks a rule; shape: (rows,), bool.
RowMask: TypeAlias = "np.ndarray | pd.Series"


@dataclass(frozen=True)
class Rule:
    """A condition on every row of a table."""

    expected: str  #: the message for a row that breaks the rule
    columns: Sequence[str]  #: the message shows their values in that row
    broken: Callable[[pd.DataFrame], RowMask]


@dataclass(frozen=True)
class ColumnType:
    """The type of a column and the rule for its values;
    a null breaks no rule, but is refused unless ``nullable``.
    """

    type: ArrowType
    expected: str = ""  #: message; ``{}`` is the column's name
    broken: Callable[[pd.Series], RowMask] | None = None
    nullable: bool = False

    @property
    def optional(self) -> ColumnType:
        """The same type, with nulls allowed."""
        return replace(self, nullable=True)

    def rules(self, name: str) -> Iterator[Rule]:
        """The rules for the rows of a table with a column ``name`` of this type."""
        if not self.nullable:
            yield Rule(
                f"expected a value in column {name!r}", [name], lambda frame: frame[name].isna()
            )
        if broken := self.broken:
            yield Rule(self.expected.format(repr(name)), [name], lambda frame: broken(frame[name]))


def at_least(low: float, kind: ArrowType) -> ColumnType:
    """Numbers in [low, ∞)."""
    return ColumnType(kind, f"expected {{}} of at least {low:g}", lambda values: values < low)


def within(low: float, high: float) -> ColumnType:
    """Real numbers in [low, high], with the tolerance ``ROUNDING``."""
    expected = f"expected {{}} from {low:g} to {high:g}"
    return ColumnType(
        "float64", expected, lambda values: (values < low - ROUNDING) | (values > high + ROUNDING)
    )


def one_of(*names: str) -> ColumnType:
    """Text that is one of ``names``."""
    expected = f"expected {{}} among {', '.join(names)}"
    return ColumnType(NAME.type, expected, lambda values: ~(values.isin(names) | values.isna()))


def _nameless(values: pd.Series) -> pd.Series:
    """Whether a text is blank, too long, or contains control characters; shape: (rows,), bool."""
    names = values.dropna().unique()
    return values.isin(
        [
            name
            for name in names
            if not re.fullmatch(rf"(?!\s*$)[^\0-\x1f\x7f]{{1,{LONGEST}}}", name)
        ]
    )


_NAMED = (
    f"expected {{}} to be a name: not blank, at most {LONGEST:,} characters, no control characters"
)
#: Names: plain, for columns of unique names; dictionary-encoded, for names that repeat.
TEXT, NAME = (ColumnType(kind, _NAMED, _nameless) for kind in ("string", "category"))
FROM_0, FROM_1 = at_least(0, "int32"), at_least(1, "int32")
REAL = ColumnType("float64", "expected {} to be finite", np.isinf)
SHARE = within(0, 1)
#: Numbers of observations: at least 1 in a row, at most ``MOST_OBSERVED`` in all rows.
COUNT = ColumnType(
    "int32",
    f"expected {{}} of at least 1, and at most {MOST_OBSERVED:,} observations in all",
    lambda values: (values < 1) | (values.astype(np.int64).cumsum() > MOST_OBSERVED),
)


def refuse(
    path: object, frame: pd.DataFrame, wrong: RowMask, columns: Iterable[str], expected: str
) -> None:
    """InputError for the first row that is ``wrong``:
    its number (from 0) and its values in ``columns``.
    """
    for row in np.flatnonzero(wrong)[:1].tolist():
        values = ", ".join(f"{name} {_shown(frame[name].iloc[row])}" for name in columns)
        raise InputError(path, f"row {row} ({values})", expected)


def _shown(value: object) -> str:
    import pandas as pd

    text = "null" if pd.isna(value) else repr(value) if isinstance(value, str) else str(value)  # type: ignore[call-overload]
    return text if len(text) <= SHOWN else f"{text[:SHOWN]}…"


def unique(*key: str) -> Rule:
    """No two rows have the same values in these columns."""
    same = ", ".join(key)
    return Rule(
        f"expected only one row with the same {same}",
        key,
        lambda frame: frame.duplicated(list(key)),
    )


def ascending(*key: str) -> Rule:
    """Rows ascend strictly, in the lexicographic order of these columns;
    text by code points, null first.
    """

    def broken(frame: pd.DataFrame) -> np.ndarray:
        steps = np.stack([np.sign(np.diff(_ranks(frame[name]))) for name in key])
        first = np.take_along_axis(steps, (steps != 0).argmax(0)[None], 0)[0]
        return np.concatenate([np.zeros(min(len(frame), 1), dtype=bool), ~(first > 0)])

    return Rule(f"expected rows in ascending order of {', '.join(key)}, each once", key, broken)


def null_without(queries: str, *measures: str) -> Rule:
    """Measures are null in rows where the number of ``queries`` is 0, and in no others."""

    def broken(frame: pd.DataFrame) -> pd.Series:
        return frame[list(measures)].isna().ne(frame[queries] == 0, axis=0).any(axis=1)

    return Rule(
        f"expected null where {queries!r} is 0, and nowhere else", (*measures, queries), broken
    )


def _ranks(values: pd.Series) -> np.ndarray:
    """Numbers in the same order as the values; shape: (rows,). Null is lowest."""
    import pandas as pd

    return (
        values.to_numpy()
        if values.dtype.kind in "biuf"
        else pd.factorize(values.astype(object), sort=True)[0]
    )
