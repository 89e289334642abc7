"""A table in files: numbers in CSV, values with their intervals in Markdown and LaTeX.

What a number is follows from its header: ``NAME low`` and ``NAME high`` bound the interval of
``NAME``, "minus" and "difference" have a sign, and values of p have three decimals. Columns that
a function lists in ``frame.attrs["any_size"]`` hold numbers of any size. A frame with
``frame.attrs["csv_alone"]`` has no other form.
"""

import re
from collections.abc import Sequence

import numpy as np
import pandas as pd

#: In files: decimals of points, epochs and per cent; significant digits of numbers of any size.
DECIMALS, DIGITS = 2, 4
ANY_SIZE, CSV_ALONE = "any_size", "csv_alone"  #: Keys of ``frame.attrs``.
_SIGNED = re.compile(r"\bminus\b|\bdifference\b|^change\b|: change$", re.IGNORECASE)
_P = re.compile(r"^p( \(Holm\))?$")


def estimates(frame: pd.DataFrame) -> list[str]:
    """The columns of a table without the bounds of intervals."""
    names = list(map(str, frame.columns))
    bounds = {f"{name}{end}" for name in names for end in (" low", " high")}
    return [name for name in names if name not in bounds]


def files(frame: pd.DataFrame) -> dict[str, str]:
    """A table as CSV, Markdown and LaTeX; all forms show the numbers of the CSV, as pages do."""
    alone, frame = frame.attrs.get(CSV_ALONE, False), rounded(frame)
    if alone:
        return {"csv": csv(frame)}
    return {"csv": csv(frame), "md": markdown(frame), "tex": latex(frame)}


def number(value: float, any_size: bool = False) -> float:
    """A number rounded to the digits on which two types of processor agree."""
    if any_size and abs(value) < 10**DIGITS and not float(value).is_integer():
        return float(f"{value:.{DIGITS}g}")
    return round(float(value), DECIMALS) + 0.0  # no -0.0


def rounded(frame: pd.DataFrame) -> pd.DataFrame:
    """A table with its numbers rounded: those of any size to significant digits, others to
    decimals.
    """
    shorter = frame.copy()
    for name in shorter.columns:
        values = shorter[name]
        if values.dtype == object or values.dtype.kind == "f":
            of_any_size = bool(_P.match(str(name))) or name in frame.attrs.get(ANY_SIZE, ())
            shorter[name] = [
                number(value, of_any_size) if isinstance(value, float) and value == value else value
                for value in values
            ]
    return shorter


def csv(frame: pd.DataFrame) -> str:
    """A table as CSV, with its numbers rounded."""
    text: str = rounded(frame).to_csv(index=False, float_format="%.10g", lineterminator="\n")
    return text


def shown(frame: pd.DataFrame) -> pd.DataFrame:
    """A table as text: each value with its interval, "–" where there is none."""
    texts = dict[str, list[str]]()
    for name, pairs in with_intervals(frame).items():
        texts[name] = [f"{value} {interval}".rstrip() for value, interval in pairs]
    return pd.DataFrame(texts)


def with_intervals(frame: pd.DataFrame) -> dict[str, list[tuple[str, str]]]:
    """By column: each value as text, and its interval, empty where there is none."""
    texts = dict[str, list[tuple[str, str]]]()
    for name in estimates(frame):
        parts = [name, f"{name} low", f"{name} high"]
        texts[name] = _texts(name, [frame[part] for part in parts if part in frame])
    return texts


def _texts(name: str, parts: Sequence[pd.Series]) -> list[tuple[str, str]]:
    values = parts[0]
    if not is_number(values):
        return [("–" if pd.isna(value) else str(value), "") for value in values]
    spec = spec_of(name, parts)
    lines = list[tuple[str, str]]()
    for row in zip(*(part.astype(float) for part in parts), strict=True):
        value, *bounds = (_written(number, spec) for number in row)
        has_interval = bool(bounds) and "–" not in bounds
        lines.append((value, f"[{', '.join(bounds)}]" if has_interval else ""))
    return lines


def is_number(values: pd.Series) -> bool:
    """Whether a column has numbers alone, or nothing."""
    if values.dtype.kind in "fiu":
        return True
    return values.dtype == object and all(
        isinstance(value, int | float) for value in values.dropna()
    )


def spec_of(name: str, parts: Sequence[pd.Series]) -> str:
    """The format of a column of rounded numbers: one decimal, none if all are whole; numbers with
    more than ``DECIMALS`` are of any size.
    """
    if _P.match(name):
        return ".3f"
    if _SIGNED.search(name):
        return "+.2f"
    values = np.concatenate([part.astype(float).to_numpy() for part in parts])
    values = values[~np.isnan(values)]
    if (values.round(3) % 1 == 0).all():
        return ",.0f"
    return "g" if (values.round(DECIMALS) != values).any() else ",.1f"


def _written(value: float, spec: str) -> str:
    if np.isnan(value):
        return "–"
    if spec == ".3f" and value < 0.001:
        return "< 0.001"
    if spec == "g":
        return any_size(value)
    digits = int(spec[-2])
    return f"{round(value, digits) + 0.0:{spec}}"  # no -0.0


def any_size(value: float) -> str:
    """A number as text: whole, with one decimal from 1 up, else with two significant digits."""
    value = round(value, 6)  # a mean may miss a whole number by its last bits
    if value.is_integer():
        return f"{value:,.0f}"
    return f"{value:.1f}" if abs(value) >= 1 else f"{value:.2g}"


def markdown(frame: pd.DataFrame) -> str:
    """A table in Markdown, aligned by the kinds of its columns."""
    sides = ["right" if is_number(frame[name]) else "left" for name in estimates(frame)]
    text = shown(frame).to_markdown(index=False, disable_numparse=True, colalign=sides)
    return f"{text}\n"


def latex(frame: pd.DataFrame) -> str:
    """A table in LaTeX (booktabs)."""
    sides = "".join("r" if is_number(frame[name]) else "l" for name in estimates(frame))
    style = shown(frame).replace("–", "--").style.hide(axis="index").format(escape="latex")
    style = style.format_index(escape="latex", axis=1)
    text: str = style.to_latex(hrules=True, column_format=sides)
    return text.replace("ξ", r"$\xi$").replace("Θ", r"$\Theta$")
