"""Tab-separated triples without a header, as PyKEEN's ``TriplesFactory.from_path`` reads them."""

from __future__ import annotations

from pathlib import Path

from isi.exports import Outgoing, form


@form("pykeen_tsv")
def pykeen_tsv(out: Outgoing, path: Path) -> dict[Path, str]:
    """The unique triples; predictions, where there are any, in a file beside it, with score and rank."""
    columns = ["head", "relation", "tail"]
    tables = {path: out.triples[columns]}
    if len(out.predictions):
        tables[path.with_name(f"{path.stem}.predictions{path.suffix}")] = out.predictions
    return {
        name: str(table.to_csv(sep="\t", header=False, index=False, lineterminator="\n"))
        for name, table in tables.items()
    }
