"""Which columns of a table of triples are head, relation and tail:
the names that people give them.
"""

from collections.abc import Sequence

from isi.errors import InputError, cut
from isi.names import plain

TRIPLE = ("head", "relation", "tail")
#: Optional columns beside them.
COUNT, PLACES = "count", ("scene", "room", "instance")
#: Other names of the columns of ``TRIPLE``, in lower case.
ALIASES = {
    "head": "h subject subj from source src start e1 entity1 node1 arg1 item",
    "relation": "r rel predicate pred relationship property prop edge label",
    "tail": "t object obj to target dst end e2 entity2 node2 arg2 value",
}
#: Last words that such a name may have beside its first ones: ``subjectLabel``, ``head_entity``.
ENDINGS = frozenset({"label", "name", "id", "entity", "node", "type"})
#: The name of a column by each name that it may have.
KNOWN = {name: name for name in (*TRIPLE, COUNT, *PLACES)} | {
    alias: name for name, aliases in ALIASES.items() for alias in aliases.split()
}
#: Parts of errors.
OTHER_NAMES = "(or subject/predicate/object and the like)"
UNKNOWN_COLUMN = (
    f"expected no column but head, relation, tail, {COUNT}, {', '.join(PLACES)}: drop it, or name "
    f"numbers of observations {COUNT}"
)


def known_columns(columns: Sequence[object]) -> list[str]:
    """The names of columns, with those that are known replaced by ``TRIPLE``, ``COUNT`` and
    ``PLACES``; where ``TRIPLE`` is there, other columns are none of its.

    Example:
        >>> from isi.columns import known_columns
        >>> known_columns(["source", "target", "relation_id", "Count", "weight"])
        ['head', 'tail', 'relation', 'count', 'weight']
    """
    names = [str(name).strip() for name in columns]
    others = [*TRIPLE, COUNT, *PLACES] if set(TRIPLE) <= set(names) else list(KNOWN)
    words = map(_without_ending, names)
    return [
        KNOWN[word] if word in others else name for word, name in zip(words, names, strict=True)
    ]


def triple_columns(columns: Sequence[object]) -> list[int]:
    """The positions of head, relation and tail among the names of columns (``known_columns``).

    InputError unless one column of each fits, and for a further column that is neither ``COUNT``
    nor among ``PLACES``.
    """
    known = known_columns(columns)
    if any(known.count(name) != 1 for name in TRIPLE):
        got = cut(", ".join(repr(str(name)[:40]) for name in columns) or "none", 100)
        expected = f"expected the columns {', '.join(TRIPLE)} {OTHER_NAMES}"
        raise InputError("", "columns", f"{expected}, got {got}")
    for name in known:
        if KNOWN.get(name) != name:
            raise InputError("", f"column {name[:40]!r}", UNKNOWN_COLUMN)
    return [known.index(name) for name in TRIPLE]


def _without_ending(name: str) -> str:
    """A name of a column as one word in lower case, without a last word among ``ENDINGS``."""
    words = plain(name.lstrip("?")).split()  # ? marks a variable of SPARQL
    if len(words) > 1 and words[-1] in ENDINGS:
        words.pop()
    return "".join(words)
