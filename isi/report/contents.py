"""What the report holds: its tables and figures, by the modules that make them."""

from __future__ import annotations

from collections.abc import Callable

from isi.report import (
    approach,
    cross_validation,
    differences,
    figures,
    gains,
    paper,
    rates,
    sensitivity,
    tables,
    transfer,
)
from isi.report.figures import Figure
from isi.report.results import Results
from isi.report.tables import Table

TABLES: tuple[Callable[[Results], Table], ...] = (
    *tables.TABLES, *sensitivity.TABLES, *cross_validation.TABLES, *rates.TABLES, *approach.TABLES,
    *transfer.TABLES, *paper.TABLES, *gains.TABLES, *differences.TABLES,
)  # fmt: skip
FIGURES: tuple[Callable[[Results], Figure | None], ...] = (
    *figures.FIGURES,
    *sensitivity.FIGURES,
    *approach.FIGURES,
    *transfer.FIGURES,
)
