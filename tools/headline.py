"""Say where a report is, and its headline numbers."""

from __future__ import annotations

import json
import sys
from pathlib import Path

ROWS = (
    ("immediate MRR*, all queries", "immediate_mrr_star", "all"),
    ("immediate MRR*, queries about novel entities", "immediate_mrr_star", "novel"),
    ("gain over Xavier in %, all queries", "improvement_over_xavier_percent", "all"),
    ("epochs to convergence, all queries", "epochs_to_convergence", "all"),
    ("  % of runs that never converge", "unconverged_percent", "all"),
    ("epochs to convergence, held-out novel", "epochs_to_convergence", "novel_heldout"),
    ("  % of runs that never converge", "unconverged_percent", "novel_heldout"),
)


def main(folder: Path) -> None:
    metrics = json.loads((folder / "metrics.json").read_text(encoding="utf-8"))
    models = list(metrics["immediate_mrr_star"]["all"])
    print(f"\n{'':46}" + "".join(f"{model:>8}" for model in models))
    for title, section, scope in ROWS:
        values = metrics[section].get(scope, {})
        print(f"{title:46}" + "".join(f"{values[m]:8.1f}" if m in values else f"{'':8}" for m in models))
    print(f"\nThe report: {folder / 'index.html'}")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
