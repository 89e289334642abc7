"""Which columns of a table of triples are head, relation and tail:
the names that people give them.
"""

from collections.abc import Sequence

from isi.errors import InputError, cut

TRIPLE = ("head", "relation", "tail")
#: Names of the columns of heads and tails, in lower case.
ENDS = (("head", "tail"), ("h", "t"), ("subject", "object"), ("from", "to"), ("source", "target"))
#: Names of the column of relations; ``LABEL``, as networkx has it, where a table has none of the
#: others.
RELATIONS, LABEL = ("relation", "rel", "r", "predicate"), "label"
#: All of these names.
COLUMN_NAMES = frozenset((*(name for pair in ENDS for name in pair), *RELATIONS, LABEL))


def triple_columns(columns: Sequence[object]) -> list[int]:
    """The positions of head, relation and tail among the names of columns;
    the case of names is ignored.

    Exactly ``TRIPLE`` wins over all other names. InputError unless one column of each fits.
    """
    places = _places(columns)
    if places is None:
        got = cut(", ".join(repr(str(name)[:40]) for name in columns) or "none", 100)
        expected = f"expected the columns {', '.join(TRIPLE)} {other_names()}"
        raise InputError("", "columns", f"{expected}, got {got}")
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
    """The names that the columns of ``TRIPLE`` may have instead, for an error."""
    pairs = ", ".join("/".join(pair) for pair in ENDS)
    return f"(or {pairs} and {'/'.join((*RELATIONS, LABEL))})"


def _places(columns: Sequence[object]) -> list[int] | None:
    """The positions of head, relation and tail; None unless one column of each fits."""
    if set(TRIPLE) <= set(columns):
        return [list(columns).index(name) for name in TRIPLE]
    names = [str(name).strip().casefold() for name in columns]
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
