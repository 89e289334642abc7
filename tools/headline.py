"""Print the headline numbers of a report and its path."""

import json
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from tabulate import tabulate  # type: ignore[import-untyped]

#: Columns: two lines of the title, and the keys of the numbers in ``metrics.json``.
COLUMNS = (
    ("immediate MRR*", "all", "immediate_mrr_star", "all"), ("immediate MRR*", "novel", "immediate_mrr_star", "novel"),
    ("gain %", "all", "improvement_over_xavier_percent", "all"),
    ("epochs", "all", "epochs_to_convergence", "all"), ("never %", "all", "unconverged_percent", "all"),
    ("epochs", "held-out", "epochs_to_convergence", "novel_heldout"),
    ("never %", "held-out", "unconverged_percent", "novel_heldout"),
)  # fmt: skip


def headline(metrics: Mapping[str, Any]) -> str:
    """The numbers of one experiment as text, a line for each model."""
    columns = [metrics.get(section, {}).get(scope, {}) for _, _, section, scope in COLUMNS]
    models = dict.fromkeys(model for scope in metrics["immediate_mrr_star"].values() for model in scope)
    rows = [[model, *(column.get(model) for column in columns)] for model in models]
    return tabulate(rows, ["", *(f"{upper}\n{lower}" for upper, lower, *_ in COLUMNS)], "plain", floatfmt=".2f")


def main(folder: Path) -> None:
    """Print the numbers of the first experiment, then those of each other experiment under its name."""
    path = folder / "metrics.json"
    try:
        metrics = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        sys.exit(f"headline: {path}: there is no report yet: run `make repro` first")
    except (OSError, ValueError) as error:
        sys.exit(f"headline: {path}: expected the metrics of a report ({error}): run `dvc repro report`")
    others = {name: value for name, value in metrics.items() if "immediate_mrr_star" in value}
    for title, part in {"": metrics, **others}.items():
        print(f"\n{title}\n{headline(part)}".replace("\n\n", "\n"))
    print(f"\nThe report: {folder / 'index.html'}")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
