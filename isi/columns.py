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


def triple_columns(columns: Sequence[object]) -> list[int]:
    """The positions of head, relation and tail among the names of columns;
    the case of names is ignored.

    Exactly ``TRIPLE`` wins over all other names. InputError unless one column of each fits.
    """
    if set(TRIPLE) <= set(columns):
        return [list(columns).index(name) for name in TRIPLE]
    names = [str(name).strip().casefold() for name in columns]
    ends = [pair for pair in ENDS if set(pair) <= set(names)]
    relations = [name for name in RELATIONS if name in names] or [
        name for name in names if name == LABEL
    ]
    if len(ends) == len(relations) == 1:
        (head, tail), (relation,) = ends[0], relations
        if names.count(head) == names.count(relation) == names.count(tail) == 1:
            return [names.index(head), names.index(relation), names.index(tail)]
    pairs = ", ".join("/".join(pair) for pair in ENDS)
    expected = (
        f"expected the columns {', '.join(TRIPLE)} (or {pairs} and {'/'.join((*RELATIONS, LABEL))})"
    )
    got = cut(", ".join(repr(str(name)[:40]) for name in columns) or "none", 100)
    raise InputError("", "columns", f"{expected}, got {got}")
