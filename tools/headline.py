"""Say where a report is, and its headline numbers."""

from __future__ import annotations

import json
import sys
from pathlib import Path

#: Title in two lines, and where its numbers are in ``metrics.json``.
COLUMNS = (
    ("MRR* at once", "all", "immediate_mrr_star", "all"),
    ("", "novel", "immediate_mrr_star", "novel"),
    ("gain %", "all", "improvement_over_xavier_percent", "all"),
    ("epochs", "all", "epochs_to_convergence", "all"),
    ("never %", "all", "unconverged_percent", "all"),
    ("epochs", "held-out", "epochs_to_convergence", "novel_heldout"),
    ("never %", "held-out", "unconverged_percent", "novel_heldout"),
)


def main(folder: Path) -> None:
    metrics = json.loads((folder / "metrics.json").read_text(encoding="utf-8"))
    models = list(metrics["immediate_mrr_star"]["all"])
    first = max(map(len, models)) + 2
    print(f"\n{'':{first}}" + "".join(f"{upper:>14}" for upper, *_ in COLUMNS))
    print(f"{'':{first}}" + "".join(f"{lower:>14}" for _, lower, *_ in COLUMNS))
    for model in models:
        values = [metrics[section].get(scope, {}).get(model) for *_, section, scope in COLUMNS]
        print(f"{model:{first}}" + "".join(f"{'' if value is None else f'{value:.1f}':>14}" for value in values))
    print(f"\nThe report: {folder / 'index.html'}")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
