"""Where this differs from the paper, and where it decides what the paper leaves open."""

from __future__ import annotations

from collections.abc import Iterator

from isi.params import Params
from isi.report.prose import joined
from isi.report.results import Results
from isi.report.section import Bullets, Content, Section


def contents(results: Results) -> Iterator[Content]:
    """A list, with this run's numbers."""
    yield (
        "Besides the graph, which has grown, and word vectors that are not word2vec's, these may matter to whoever "
        "sets [the numbers](#paper) beside each other. The paper says otherwise or nothing."
    )
    yield Bullets([*learning(results.params), *asking(results.params), *inserting(results.params)])


def learning(params: Params) -> Iterator[str]:
    """How embeddings are trained."""
    negatives, training, tuning = params.negatives, params.training, params.finetuning
    drawn = "enter in expectation" if negatives.mode == "expected" else "are drawn"
    yield (
        f"Negatives: {negatives.ratio} corrupted tails, heads and relations each, so {3 * negatives.ratio} to a "
        f"positive (the paper has a ratio of 9 and does not say of what). They {drawn}, and a corrupted relation never "
        "is the true one."
    )
    if negatives.head_pool == "unseen":
        yield "Corrupted heads are entities that were never seen as a head of that relation in training."
    yield (
        f"Updates: in batches of {tuning.batch_size:,} with a fine-tuning rate of {tuning.learning_rate:g}; the "
        "paper's 0.002 goes with one update for each observation."
    )
    yield (
        f"Θ⁰ and the joint model stop after {training.patience} looks at validation triples, {training.evaluate_every} "
        f"epochs apart, without a better one, or at {training.max_epochs} epochs; the paper does not say when its do."
    )
    yield (
        "Splits: the first triple, in random order, of every entity and every relation is pinned to training, so that "
        "each is trained; what is asked is drawn from the others."
    )


def asking(params: Params) -> Iterator[str]:
    """How MRR* is measured."""
    yield (
        "Ranks: rivals of the answer that were observed as often as it are left out, since nothing ranks them; a tied "
        "score counts half."
    )
    yield (
        "Means: relations are weighted by their counts of observations, and half of MRR* asks for entities, half for "
        "relations; the paper does not give its weights."
    )
    yield (
        f"The rule for the indicator set size is applied to a grid ({joined(map(str, params.sweep.k))}): neighbours "
        "are those of the grid, however far apart."
    )


def inserting(params: Params) -> Iterator[str]:
    """How novel entities are inserted."""
    yield (
        f"Insert triples: a share of {params.sessions.insert_fraction:g} of a novel entity's training triples whose "
        "other end is known, at least one, each counted once. None is of validation or test."
    )
    yield (
        "Similarity: cosines wherever the paper's equations 3 and 5 have dot products (its text says cosine), and a "
        "relation's inverse is clamped away from infinity."
    )
    for experiment in params.experiments.values():
        if extend := experiment.graph.extend:
            yield (
                f"{experiment.title}: of the {extend.candidates} candidates {joined(extend.always)} are no draw but "
                "always among them, since Table 3 asks about them. Objects come as tallies by room."
            )


SECTION = Section("departures", "Where this differs from the paper", contents)
