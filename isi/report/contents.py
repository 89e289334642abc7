"""What the page holds: its sections, from what is asked first to what is looked up."""

from __future__ import annotations

from dataclasses import replace
from importlib import import_module

from isi.report.section import Section

#: Parts of the page, each with modules of ``isi/report/sections``, which export their ``SECTION``.
GROUPS = {
    "How to read this page": ("guide",),
    "What a new vector knows at once": ("at_once", "asked", "controls", "strong", "told", "vectors", "affordances"),
    "Look for yourself": ("explorer",),
    "What training makes of it": ("epochs", "earlier"),
    "Does it hold elsewhere?": ("transfer", "graphs", "embeddings"),
    "Beside the paper": (
        "paper", "causes", "departures", "approach", "sensitivity", "cross_validation", "families",
    ),
    "How far to trust it": ("differences", "graph", "words", "run"),
}  # fmt: skip

SECTIONS: tuple[Section, ...] = tuple(
    replace(import_module(f"isi.report.sections.{name}").SECTION, group=group)
    for group, names in GROUPS.items()
    for name in names
)
