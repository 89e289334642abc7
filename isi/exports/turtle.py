"""RDF in Turtle."""

from __future__ import annotations

from pathlib import Path

from isi.exports import Outgoing, form
from isi.exports._rdf import rdf_of


@form("turtle")
def turtle(out: Outgoing, path: Path) -> dict[Path, str | None]:
    """One file."""
    return {path: rdf_of(out).serialize(format="turtle")}
