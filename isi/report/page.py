"""The page: one self-contained HTML file, and every table and figure as files beside it."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any

import pandas as pd
from jinja2 import Environment, PackageLoader, StrictUndefined, select_autoescape

from isi.report import cross_validation, differences, gains, rates, sensitivity, transfer
from isi.report.figures import Figure
from isi.report.metrics import metrics, plots
from isi.report.results import ISI, Results
from isi.report.tables import CONTROLS, Table, label
from isi.tables import atomically


def write(
    folder: Path, results: Results, tables: Iterable[Table], figures: Iterable[Figure], run: Mapping[str, Any]
) -> None:
    """Write the page and everything beside it; each file whole or not at all.

    Args:
        run: what was run, by title: mappings of names to values.
    """
    tables, figures = list(tables), list(figures)
    files: dict[Path, bytes] = {}
    for table in tables:
        files |= {folder / "tables" / f"{table.name}.{form}": text.encode() for form, text in _forms(table).items()}
    for figure in figures:
        files |= {folder / "figures" / f"{figure.name}.{form}": figure.rendered(form) for form in ("svg", "png")}
    for name, frame in plots(results).items():
        files[folder / "plots" / f"{name}.csv"] = frame.to_csv(index=False, float_format="%.4f").encode()
    headline = metrics(results)
    files[folder / "metrics.json"] = (json.dumps(headline, indent=2) + "\n").encode()
    files[folder / "index.html"] = _html(results, tables, figures, headline, run).encode()
    for path, content in files.items():
        atomically(path, lambda temporary, content=content: temporary.write_bytes(content))  # type: ignore[misc]
    for part in ("tables", "figures", "plots"):
        for path in set((folder / part).iterdir()) - set(files):
            path.unlink()


def _forms(table: Table) -> dict[str, str]:
    shown = shorten(table.frame, table.formats)
    return {
        "csv": table.frame.to_csv(index=False, float_format="%.6g", lineterminator="\n"),
        "md": shown.to_markdown(index=False, disable_numparse=True, colalign=_alignment(table)) + "\n",
        "tex": _latex(table, shown),
    }


def shorten(frame: pd.DataFrame, formats: Mapping[str, Callable[[Any], str]] | None = None) -> pd.DataFrame:
    """Numbers as people read them: one decimal, none for whole columns, a dash for what is not there."""
    formats = formats or {}
    return pd.DataFrame(
        {name: [_shown(value, frame[name], formats.get(name)) for value in frame[name]] for name in frame.columns}
    )


def _shown(value: Any, column: pd.Series, how: Callable[[Any], str] | None) -> str:
    if value is None or (isinstance(value, float) and pd.isna(value)):
        return "–"
    if isinstance(value, str):
        return value
    if how is not None:
        return how(value)
    whole = pd.to_numeric(column, errors="coerce").dropna().mod(1).eq(0).all()
    return f"{value:,.0f}" if whole else f"{value:,.1f}"


def _alignment(table: Table) -> tuple[str, ...]:
    frame = table.frame
    texts = [
        name not in table.formats and frame[name].map(lambda value: isinstance(value, str)).any() for name in frame
    ]
    return tuple("left" if text else "right" for text in texts)


def _latex(table: Table, shown: pd.DataFrame) -> str:
    columns = "".join(side[0] for side in _alignment(table))
    text = shown.replace("–", "--").style.hide(axis="index").format(escape="latex").format_index(escape="latex", axis=1)
    latex: str = text.to_latex(hrules=True, column_format=columns)
    return latex.replace("ξ", r"$\xi$").replace("Θ", r"$\Theta$")


def _html(
    results: Results, tables: list[Table], figures: list[Figure], headline: Mapping[str, Any], run: Mapping[str, Any]
) -> str:
    environment = Environment(
        loader=PackageLoader("isi.report"), autoescape=select_autoescape(), undefined=StrictUndefined, trim_blocks=True
    )
    return environment.get_template("page.html").render(
        tables={table.name: table for table in tables},
        shorten=shorten,
        numeric=lambda table: [side == "right" for side in _alignment(table)],
        figures={figure.name: figure for figure in figures},
        svg=_inline,
        about_known=_share_about_known(results),
        headline=headline,
        label=label,
        isi=[name for name in ISI if name in results.initializers],
        contenders=[name for name in results.initializers if name not in CONTROLS],
        controls=[name for name in CONTROLS if name in results.initializers],
        gains=gains.sentences(results),
        told_apart=differences.sentences(results),
        level=differences.LEVEL,
        by_rate=rates.sentences(results),
        picked=sensitivity.picked_sizes(results),
        used={name: getattr(results.params.initializers, name).k for name in ISI},
        top=transfer.TOP,
        best_setting=cross_validation.sentence(results),
        params=results.params,
        paper=results.paper,
        run=run,
    )


def _inline(figure: Figure) -> str:
    """A figure as an element of the page."""
    text = figure.rendered("svg").decode()
    return text[text.index("<svg") :]


def _share_about_known(results: Results) -> float:
    """Share of the queries of scope all that are about known entities alone."""
    queries = results.at_once[results.at_once["model"] == results.initializers[0]].groupby("scope")["queries"].sum()
    return float(queries["known"] / queries["all"])
