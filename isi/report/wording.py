"""What the page calls what tables of files have short names for; files keep theirs, which others read."""

from __future__ import annotations

import re
from collections.abc import Mapping

#: What is asked in each scope.
SCOPES = {
    "all": "all queries",
    "novel": "novel entities",
    "novel_heldout": "novel entities, held out",
    "known": "earlier knowledge",
    "known_closed": "earlier knowledge by itself",
}
#: Headers that are not what people say.
_HEADERS = {
    "entity half": "asks for entities",
    "relation half": "asks for relations",
    "std": "deviation",
    "scope": "queries",
    "scope's filter": "usual filter",
    "all true": "all true triples left out",
    "unconverged %": "never converged, %",
    "p (Holm)": "p, corrected",
    "of these differ": "seeds that differ",
    "share %": "share, %",
    "gain %": "gain, %",
    "drop %": "drop, %",
    "asked about": "asked about the novel entity",
}
_SCOPED = re.compile(rf"\bscope ({'|'.join(sorted(SCOPES, key=len, reverse=True))})\b")
_BARE = re.compile(rf"^({'|'.join(sorted(SCOPES, key=len, reverse=True))})(?=$|,)")
#: What a header ends in where it is of one time of two.
_WHEN = (" at once", " at the end")


def spoken(text: str) -> str:
    """Text with scopes by what people call them."""
    return _SCOPED.sub(_name, text)


def header(name: str, titles: Mapping[str, str]) -> tuple[str, str]:
    """Of a column: what it shares with its neighbours, or nothing, and what it is.

    Args:
        titles: what experiments are called.
    """
    group, _, own = name.rpartition(": ")
    for when in _WHEN:
        if not group and own.endswith(when):
            group, own = when.strip(), own.removesuffix(when)
    before, _, scope = group.rpartition(", ")
    group = (
        f"{before}: {SCOPES[scope]}" if before and scope in SCOPES else _HEADERS.get(group) or _BARE.sub(_name, group)
    )
    own = titles.get(own, own)
    own = _HEADERS.get(own) or _BARE.sub(_name, spoken(own))
    return group, own


def cell(column: str, text: str, titles: Mapping[str, str]) -> str:
    """What stands in a cell: scopes, halves and experiments by what people call them."""
    if column in ("scope", "measure", "of"):
        return _HEADERS.get(text) or _BARE.sub(_name, spoken(text))
    if column == "experiment":
        return titles.get(text, text)
    return spoken(text)


def _name(place: re.Match[str]) -> str:
    return SCOPES[place[1]]
