"""RDF in JSON-LD, expanded, in order."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from isi.exports import Outgoing, form
from isi.exports._rdf import rdf_of


@form("jsonld")
def jsonld(out: Outgoing, path: Path) -> dict[Path, str | None]:
    """One file."""
    nodes = json.loads(rdf_of(out).serialize(format="json-ld"))
    return {path: json.dumps(_in_order(nodes), indent=1, sort_keys=True, ensure_ascii=False) + "\n"}


def _in_order(value: Any) -> Any:
    """The same, each list by what its parts say: rdflib goes by hashes, which differ from one process to the next."""
    if isinstance(value, dict):
        return {key: _in_order(part) for key, part in value.items()}
    if isinstance(value, list):
        return sorted(map(_in_order, value), key=lambda part: json.dumps(part, sort_keys=True))
    return value
