"""The default initializer: the best for hidden known entities that does not harm earlier triples.

Each candidate inserts the hidden entities of the hold-out test (``isi.insertion.hidden``); the
selected one has the highest MRR about them among those that keep the MRR of earlier triples.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from isi.errors import InputError
from isi.initializers.api import INITIALIZERS, Registered, options_of
from isi.initializers.evidence import SAMPLE
from isi.insertion.arguments import naming_argument
from isi.insertion.engine import Method
from isi.insertion.hidden import HIDDEN, QUERIES, Candidate, HoldOut
from isi.insertion.inverses import InverseRelations, unpack_first
from isi.models.model import Model

if TYPE_CHECKING:
    import pandas as pd

#: The initializers that are preferred by default, the best first (compared in docs/method.md). The
#: first one whose data are given and that supports the model is always a candidate.
PREFERRED = ("map", "soft_es", "mean")
PAIRS = 2**29  #: Maximum number of word similarities of entity pairs.
#: Number of hidden entities for which no candidate is left out to save work.
LEAST_HIDDEN = 20
#: Multiplications in a second, and as many as the overhead of one candidate takes. They turn a
#: budget of seconds into one of work, so that the selection depends on the arguments alone and not
#: on a clock.
RATE, OVERHEAD = 1.4e10, 7e7
STEPS = 8  #: Assumed number of steps of Newton's method.
#: As many multiplications of a product take the time of a step's work on one number of a vector.
ELEMENTWISE = 300
#: The MRR of earlier triples is near chance if it is below so many times that of random ranks.
NEAR_RANDOM = 2.0


@dataclass(frozen=True)
class Selection:
    """The candidates for the default initializer, and the selected one."""

    candidates: list[Candidate]
    selected: Candidate
    tolerance: float  #: largest loss of MRR that is no harm
    hidden: int  #: number of hidden entities
    queries: int  #: number of their queried triples
    most_hidden: int  #: largest number of hidden entities that the budget allows
    random_mrr: float  #: expected MRR of earlier triples at random ranks

    @property
    def why(self) -> str:
        number = len(self.candidates)
        return f"the best of {number} candidates for {self.hidden} hidden known entities"

    @property
    def warnings(self) -> list[str]:
        """Sentences: even the best harms; the model has not learned its own triples."""
        best, sentences = self.selected, list[str]()
        if best.loss > self.tolerance:
            sentences.append(
                f"every candidate harms: {best.initializer} harms least, and with it the MRR of"
                f" earlier triples falls by {best.loss:.3f} (tolerance {self.tolerance:g};"
                f" of trained triples from {best.h_old:.3f} to {best.h_cur:.3f})"
            )
        if best.h_old < NEAR_RANDOM * self.random_mrr:
            sentences.append(
                "the model ranks its own triples almost at random "
                f"(MRR {best.h_old:.3f}, at random {self.random_mrr:.3f}): "
                "no vector of a new entity helps before it is trained longer"
            )
        return sentences

    @property
    def expected(self) -> dict[str, float]:
        """The measures of the selected candidate."""
        measures = asdict(self.selected).items()
        return {name: value for name, value in measures if isinstance(value, float)}

    def to_frame(self) -> pd.DataFrame:
        """A row per candidate: the fields of ``Candidate``, number of queried triples,
        whether it was chosen.
        """
        import pandas as pd

        rows = []
        for candidate in self.candidates:
            is_selected = candidate is self.selected
            rows.append(asdict(candidate) | {"queries": self.queries, "chosen": is_selected})
        return pd.DataFrame(rows)


def select(
    test: HoldOut, has_triples: bool, has_words: bool, *, tolerance: float, budget: float
) -> tuple[Method, Selection | None]:
    """The default initializer, and the comparison behind it if there can be one.

    The preferred ones, optima of an objective and own initializers are compared. ES, RS and ERS are
    not: this test underestimates their harm (docs/insert.md).

    Args:
        test: the hold-out test; ``has_triples``, ``has_words``: whether new entities have any.
        tolerance, budget: see ``compare``.
    """
    model, entities = test.theta0.model, test.theta0.entity.shape[1]
    method = preferred(model, has_triples, has_words)
    compared = [method.initializer]
    for each in suited_to(model, has_triples, has_words):
        serves = each.cost == "newton" or each.role == "own" or each.name in PREFERRED
        if serves and each.name != method.initializer.name and not is_too_large(each, entities):
            compared.append(each)
    selection = compare(compared, test, tolerance, budget)
    if selection is None:
        return method, None
    best = selection.selected
    initializer = next(each for each in compared if each.name == best.initializer)
    return Method(initializer, best.options, selection.why), selection


def preferred(model: Model, has_triples: bool, has_words: bool) -> Method:
    """The first of ``PREFERRED`` for the given data."""
    suited = {each.name: each for each in suited_to(model, has_triples, has_words)}
    initializer = next(suited[name] for name in PREFERRED if name in suited)
    why = "the best for " + " and ".join(["words"] * has_words + ["triples"] * has_triples)
    return Method(initializer, dict(initializer.defaults), why)


def named(initializer: str, options: dict[str, object], model: Model, entities: int) -> Method:
    """The initializer of a name; ``options`` replace its defaults.

    ``InputError`` if it or an option is unknown, the model does not support it, or the embedding of
    so many ``entities`` is too large for it.
    """
    with naming_argument("initializer"):
        registered = INITIALIZERS.get(initializer, "initializer")
        checked = options_of(initializer, {**registered.defaults, **options}, "initializer")
        registered.check(model)
        if is_too_large(registered, entities):
            work = f"which compares the words of every two of {entities:,} entities: choose another"
            raise InputError("", "", f"the embedding is too large for {initializer}, {work}")
    return Method(unpack_first(registered, model), checked, "as named")


def is_too_large(initializer: Registered, entities: int) -> bool:
    return initializer.cost == "pairs" and entities**2 > PAIRS


def suited_to(model: Model, has_triples: bool, has_words: bool) -> list[Registered]:
    """The registered initializers that support the model and need no more than the given data."""
    lacking = set()
    if not has_words:
        lacking.add("words")
    if not has_triples:
        lacking.add("insert_triples")
    every = [INITIALIZERS.get(name, name) for name in INITIALIZERS.names()]
    suited = [each for each in every if not lacking & set(each.needs) and not each.misses(model)]
    return [unpack_first(each, model) for each in suited]


def one_score(model: Model) -> Model:
    """The model, with heads scored by the relation and not by its inverse: the hold-out test has
    one score per triple.
    """
    return replace(model, heads_by_inverse=False) if isinstance(model, InverseRelations) else model


def compare(
    initializers: Sequence[Registered], test: HoldOut, tolerance: float, budget: float
) -> Selection | None:
    """Compare initializers, each with its defaults and with the options in its ``calibration``.

    None if there are too few known triples, or the embedding is too large for the budget.

    Args:
        initializers: those whose needs are met by the model and the data; the first is always
            compared.
        tolerance: largest loss of the MRR of earlier triples that is no harm.
        budget: seconds of one core, by an estimate of the work; limits the number of hidden
            entities, and if these are few, that of candidates: defaults, the cheaper first, come
            before other options.
    """
    work = {each.name: work_of(each, test) for each in initializers}
    first, *others = initializers
    ordered = [first, *sorted(others, key=lambda each: work[each.name])]
    settings = [(each, dict(each.defaults)) for each in ordered]
    for each in ordered:
        # with facts, no more than one by words alone
        if each.needs != ("words",) or not test.numbers.any():
            settings += [(each, {**each.defaults, **options}) for options in each.calibration]
    total = np.cumsum([work[each.name] for each, _ in settings])
    # number of hidden entities that the budget allows, for each number of candidates
    possible = (budget * RATE - OVERHEAD * np.arange(1, len(settings) + 1)) / total
    affordable = int((possible >= min(LEAST_HIDDEN, test.theta0.entity.shape[1])).sum())
    if not affordable:
        return None
    most_hidden = min(HIDDEN, int(possible[affordable - 1]))
    draws = test.hide(most_hidden)
    if draws is None:
        return None
    measured = [draws.measure(each, options) for each, options in settings[:affordable]]
    candidates = [candidate for candidate in measured if candidate is not None]
    if not candidates:
        return None
    return Selection(
        candidates,
        select_by_rule(candidates, tolerance),
        tolerance,
        hidden=draws.context.novel.numel(),
        queries=int(draws.about.counted.sum()),
        most_hidden=most_hidden,
        random_mrr=draws.random_mrr,
    )


def select_by_rule(candidates: Sequence[Candidate], tolerance: float) -> Candidate:
    """The first with the highest ``about`` among losses of at most ``tolerance``;
    if none, with the least loss.
    """
    harmless = [candidate for candidate in candidates if candidate.loss <= tolerance]
    if harmless:
        return max(harmless, key=lambda candidate: candidate.about)
    return min(candidates, key=lambda candidate: candidate.loss)


def work_of(initializer: Registered, test: HoldOut) -> float:
    """Estimated number of multiplications for each hidden entity:
    to insert it, and to rank the queries about it.
    """
    _, entities, dimension = test.theta0.entity.shape
    ranking = 2 * QUERIES * entities * (dimension + 20)
    if initializer.cost == "pairs":
        return ranking + entities**2 * (1 if test.words is None else test.words.shape[1])
    if initializer.cost == "entities":
        return ranking + 4 * entities * dimension
    numbers_of_triples = (
        test.numbers.mean() * entities,
        test.numbers.mean() * test.theta0.relation.shape[1],
        2 * len(test.triples),
    )
    for_each = dimension * (dimension + (0 if test.theta0.model.linear else ELEMENTWISE))
    return ranking + STEPS * sum(min(SAMPLE, number) for number in numbers_of_triples) * for_each
