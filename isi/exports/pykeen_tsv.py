"""Tab-separated triples without a header, as PyKEEN's ``TriplesFactory.from_path`` reads them."""

from __future__ import annotations

from pathlib import Path

import pandas as pd

from isi.exports import Outgoing, form


@form("pykeen_tsv")
def pykeen_tsv(out: Outgoing, path: Path) -> dict[Path, str | None]:
    """The unique triples; predictions, where there are any, in a file beside it, with score and rank."""
    beside = path.with_name(f"{path.stem}.predictions{path.suffix}")
    return {
        path: _tsv(out.triples[["head", "relation", "tail"]]),
        beside: _tsv(out.predictions) if len(out.predictions) else None,
    }


def _tsv(table: pd.DataFrame) -> str:
    return str(table.to_csv(sep="\t", header=False, index=False, lineterminator="\n"))
