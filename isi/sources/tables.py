"""Tables of what a source was observed to hold, from which graphs are built."""

from __future__ import annotations

from isi.tables.rules import at_least, counted, named
from isi.tables.table import INT, LONG, NAME, TEXT, Table

#: One row per instance, or per tally with its number.
OBSERVATIONS = Table(
    "data/observations/{source}.parquet",
    {"scene": NAME, "room": NAME, "instance": TEXT, "head": NAME, "relation": NAME, "tail": NAME, "count": INT},
    checks=[*named("room", "head", "relation", "tail"), *counted()],
    nullable=["scene", "room", "instance"],
)
#: The entities of a source.
KINDS = Table(
    "data/observations/{source}.entities.parquet",
    {"entity": TEXT, "kind": NAME, "phrase": TEXT},
    key=["entity"],
    checks=named("entity", "kind", "phrase"),
)
#: How many instances each step of mining leaves.
MINED = Table(
    "data/observations/{source}.mined.parquet",
    {"step": TEXT, "instances": LONG},
    key=["step"],
    checks=at_least(0, "instances"),
)
