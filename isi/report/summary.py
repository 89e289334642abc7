"""What stands above all sections: the question, and the answer in numbers."""

from __future__ import annotations

from collections.abc import Iterator
from math import nan

from isi.report import statistics
from isi.report.models import JOINT, contenders, controls
from isi.report.prose import capitalized, listed
from isi.report.results import Results

TITLE = "Incremental semantic initialization"


def paragraphs(results: Results) -> Iterator[str]:
    """The question, and what the first graph of its own answers."""
    yield (
        "A robot that knows its home as a knowledge-graph embedding meets a new concept. Does it help to give the "
        "concept a vector at the centroid of a few entities that it already knows, chosen by words (ES), by relations "
        "(RS) or by both (ERS), instead of a random one (Xavier, informed uniform)? Daruna, Liu, Kira and Chernova "
        "(2019) say yes. This page asks again, with their numbers beside ours, and controls that they did not have."
    )
    for experiment in results.own[:1]:
        sessions, initializers = experiment.how.sessions, experiment.initializers
        now = statistics.mrr_star(experiment.at_once, experiment.models)
        everything, novel = now.get("all", {}), now.get("novel", {})
        tested, others = contenders(initializers), controls(initializers)
        yield (
            f"{capitalized(experiment.title)}: {sessions.seeds} repeats of {len(sessions.sizes)} set sizes on "
            f"{experiment.triples['count'].sum():,} observations. MRR* over all queries right after insertion: "
            f"{listed(everything, tested)}; a joint model, trained on everything, has "
            f"{everything.get(JOINT, nan):.1f}. About the novel entities alone: {listed(novel, tested)}."
        )
        if others:
            yield (
                f"Controls, each with a part of what ISI has: {listed(everything, others)} over all queries, "
                f"{listed(novel, others)} about the novel entities. [What the gain is made of](#controls) says how "
                "much is centre, kind and meaning. Brackets are 95 % intervals over seeds, which speak of this graph "
                "alone (see [differences](#differences))."
            )
