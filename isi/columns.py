"""Which columns of a table of triples are head, relation and tail:
the names that people give them.
"""

from collections.abc import Sequence

from isi.errors import InputError, cut
from isi.names import plain

TRIPLE = ("head", "relation", "tail")
#: Optional columns beside them.
COUNT, PLACES = "count", ("scene", "room", "instance")
#: Names of the columns of heads and tails, in lower case.
ENDS = (
    ("head", "tail"),
    ("h", "t"),
    ("subject", "object"),
    ("from", "to"),
    ("source", "target"),
    ("e1", "e2"),
    ("entity1", "entity2"),
    ("node1", "node2"),
    ("item", "value"),
)
#: Names of the column of relations; ``LABEL``, as networkx has it, where a table has none of the
#: others.
RELATIONS = ("relation", "rel", "r", "predicate", "relationship", "property", "prop")
LABEL = "label"
#: Last words that such a name may have beside its first ones: ``subjectLabel``, ``head_entity``.
ENDINGS = frozenset({"label", "name", "id", "entity", "node"})
#: All of these names.
COLUMN_NAMES = frozenset((*(name for pair in ENDS for name in pair), *RELATIONS, LABEL))
#: Message of an error.
UNKNOWN_COLUMN = (
    f"expected no column but head, relation, tail, {COUNT}, {', '.join(PLACES)}: drop it, or name "
    f"numbers of observations {COUNT}"
)


def triple_columns(columns: Sequence[object]) -> list[int]:
    """The positions of head, relation and tail among the names of columns;
    the case of names is ignored.

    Exactly ``TRIPLE`` wins over all other names. InputError unless one column of each fits, and for
    a further column that is neither ``COUNT`` nor among ``PLACES``.
    """
    places = _places(columns)
    if places is None:
        got = cut(", ".join(repr(str(name)[:40]) for name in columns) or "none", 100)
        expected = f"expected the columns {', '.join(TRIPLE)} {other_names()}"
        raise InputError("", "columns", f"{expected}, got {got}")
    for place, name in enumerate(columns):
        if place not in places and str(name).strip().casefold() not in (COUNT, *PLACES):
            raise InputError("", f"column {str(name)[:40]!r}", UNKNOWN_COLUMN)
    return places


def with_triple(columns: Sequence[str]) -> list[str]:
    """The names of columns, with those of head, relation and tail replaced by ``TRIPLE``;
    unchanged unless one column of each fits.

    Example:
        >>> from isi.columns import with_triple
        >>> with_triple(["source", "target", "relation", "count"])
        ['head', 'tail', 'relation', 'count']
    """
    renamed = list(columns)
    for name, place in zip(TRIPLE, _places(columns) or (), strict=False):
        renamed[place] = name
    return renamed


def other_names() -> str:
    """Some of the names that the columns of ``TRIPLE`` may have instead, for an error."""
    pairs = ", ".join("/".join(pair) for pair in ENDS[1:6])
    return f"(or {pairs} and {'/'.join((*RELATIONS[1:4], LABEL))})"


def _places(columns: Sequence[object]) -> list[int] | None:
    """The positions of head, relation and tail; None unless one column of each fits."""
    if set(TRIPLE) <= set(columns):
        return [list(columns).index(name) for name in TRIPLE]
    typed = [str(name).strip().casefold() for name in columns]
    return _matching(typed) or _matching([_without_ending(str(name)) for name in columns])


def _without_ending(name: str) -> str:
    """A name of a column as one word in lower case, without a last word among ``ENDINGS``."""
    words = plain(name.strip().lstrip("?")).split()  # ? marks a variable of SPARQL
    if len(words) > 1 and words[-1] in ENDINGS:
        words.pop()
    return "".join(words)


def _matching(names: Sequence[str]) -> list[int] | None:
    ends = [pair for pair in ENDS if set(pair) <= set(names)]
    relations = [name for name in RELATIONS if name in names] or [
        name for name in names if name == LABEL
    ]
    if len(ends) != 1 or len(relations) != 1:
        return None
    (head, tail), (relation,) = ends[0], relations
    if any(names.count(name) > 1 for name in (head, relation, tail)):
        return None
    return [names.index(head), names.index(relation), names.index(tail)]
