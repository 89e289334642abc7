"""The order of the page: its sections, from the questions that are asked first to what is looked up."""

from __future__ import annotations

from importlib import import_module

from isi.report.section import Section

#: Parts of the page with their sections, each a function of a module in ``isi/report/sections``.
CONTENTS = {
    "How to read this page": ("run.guide",),
    "What a new vector knows immediately": (
        "immediate.immediate", "queries.query_breakdown", "gain.controls", "initializers.stronger",
        "initializers.n_insert_triples", "initializers.other_words", "immediate.affordances",
    ),
    "Look for yourself": ("explorer.explorer",),
    "What training makes of it": ("convergence.convergence", "forgetting.forgetting"),
    "Does it hold elsewhere?": ("transfer.transfer", "graphs.other_graphs", "graphs.embeddings"),
    "Beside the paper": (
        "paper.paper", "paper.causes", "run.departures", "trajectory.trajectory", "choices.indicators",
        "choices.cross_validation", "choices.embedding_models",
    ),
    "How far to trust it": ("differences.differences", "run.graph", "run.definitions", "run.run"),
}  # fmt: skip


def section(place: str, group: str = "") -> Section:
    """A section by its module and function; where the module has a ``TEXT``, that is its template."""
    module_name, _, name = place.rpartition(".")
    module = import_module(f"isi.report.sections.{module_name}")
    return Section(name, getattr(module, name), getattr(module, "TEXT", None), group)


SECTIONS = tuple(section(place, group) for group, places in CONTENTS.items() for place in places)
