"""Print the headline numbers of a report, its path and, for the project's own,
a comparison with the last commit.
"""

import json
import sys
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from tabulate import tabulate  # type: ignore[import-untyped]

from isi.config import value_of
from tools.committed import ROOT, against_commit

#: The keys of each column in ``metrics.json``, by the two lines of its title.
COLUMNS = {
    "MRR\nweighted": "immediate_mrr.weighted",
    "MRR\nknown": "immediate_mrr.known",
    "MRR\nnovel": "immediate_mrr.novel",
    "gain\n%": "gain_over_xavier_percent",
    "epochs\nmean": "epochs_to_convergence",
    "runs that\ndo not end": "runs_without_convergence",
}
#: In the folder of a pipeline: the metrics of its last two runs that differ.
KEPT = Path(".dvc/tmp/metrics.json")


def headline(metrics: Mapping[str, Any]) -> str:
    """The numbers of one experiment as text, a line for each model."""
    return _text(_numbers(metrics), ".2f")


def changes(metrics: Mapping[str, Any], before: Mapping[str, Any]) -> str:
    """The differences of the numbers in both from those before,
    a line for each model that has one; or no text.
    """
    new, old = _numbers(metrics), _numbers(before)
    apart = (new - old).round(2).replace(0, np.nan).dropna(how="all")
    return _text(apart.loc[new.index.intersection(apart.index, sort=False)], "+.2f")


def _numbers(metrics: Mapping[str, Any]) -> pd.DataFrame:
    """Rows by model, columns as in ``COLUMNS``."""
    columns = {
        title: pd.Series(value_of(metrics, key) or {}, dtype=float)
        for title, key in COLUMNS.items()
    }
    of_scopes = metrics["immediate_mrr"].values()
    models = dict.fromkeys(model for scope in of_scopes for model in scope)
    return pd.DataFrame(columns, list(models))


def _text(numbers: pd.DataFrame, form: str) -> str:
    if numbers.empty:
        return ""
    shown = numbers.astype(object).where(numbers.notna(), None)
    return str(tabulate(shown, list(COLUMNS), "plain", floatfmt=form))


def last(path: Path, metrics: Mapping[str, Any]) -> Mapping[str, Any]:
    """The metrics of the last run here whose metrics differ, or none;
    ``path`` keeps them, and these, for next time.
    """
    kept: list[Mapping[str, Any]] = []
    with suppress(OSError, ValueError):  # there is none, or it was cut short
        kept = json.loads(path.read_text(encoding="utf-8"))
    if metrics not in kept[-1:]:
        kept = [*kept[-1:], metrics]
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(json.dumps(kept), encoding="utf-8")
    return dict(kept[0]) if len(kept) > 1 else {}


def parts(metrics: Mapping[str, Any]) -> dict[str, Mapping[str, Any]]:
    """The numbers of each experiment by its name."""
    return {name: value for name, value in metrics.items() if "immediate_mrr" in value}


def main(folder: Path) -> None:
    """Print the numbers of each experiment, and how they changed."""
    path = folder / "metrics.json"
    try:
        metrics = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        sys.exit(f"headline: {path}: there is no report yet: run `make repro` first")
    except (OSError, ValueError) as error:
        sys.exit(
            f"headline: {path}: expected the metrics of a report ({error}): run `dvc repro report`"
        )
    before = last(folder.parent / KEPT, metrics) if (folder.parent / ".dvc").exists() else {}
    for title, part in parts(metrics).items():
        print(f"\n{title}\n{headline(part)}")
        if differences := title in parts(before) and changes(part, parts(before)[title]):
            print(f"Change since the previous run:\n{differences}")
    print(f"\nThe report: {folder / 'index.html'}")
    if folder.resolve() == ROOT / "reports":
        print(against_commit("reports/metrics.json"))


if __name__ == "__main__":
    main(Path(sys.argv[1]))
