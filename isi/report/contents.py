"""What the page holds: its sections, in order."""

from __future__ import annotations

from importlib import import_module

from isi.report.section import Section

#: Modules of ``isi/report/sections``, each of which exports its ``SECTION``.
ORDER = (
    "approach",
    "graph",
    "at_once",
    "asked",
    "controls",
    "strong",
    "embeddings",
    "graphs",
    "told",
    "vectors",
    "epochs",
    "differences",
    "earlier",
    "transfer",
    "affordances",
    "sensitivity",
    "cross_validation",
    "families",
    "words",
    "causes",
    "departures",
    "paper",
    "run",
)

SECTIONS: tuple[Section, ...] = tuple(import_module(f"isi.report.sections.{name}").SECTION for name in ORDER)
