"""The default initializer: the best for hidden known entities, with a price on harm.

Each candidate inserts the hidden entities of the hold-out test (``isi.insertion.hidden``); the
selected one has the highest MRR about them, less ``PRICE`` times the harm beyond the tolerance.
"""

from __future__ import annotations

from collections.abc import Hashable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
import torch

from isi.errors import InputError
from isi.initializers.api import INITIALIZERS, Registered, options_of
from isi.initializers.evidence import SAMPLE
from isi.initializers.newton import CURVED
from isi.initializers.scale import QUERIES as KNOWN_QUERIES
from isi.initializers.scale import Scale
from isi.initializers.softmax import CANDIDATES
from isi.insertion.arguments import naming_argument
from isi.insertion.engine import Method
from isi.insertion.hidden import HIDDEN, QUERIES, Candidate, HiddenDraws, HoldOut
from isi.insertion.inverses import InverseRelations, unpack_first
from isi.models.model import Model
from isi.models.stack import Embedding

if TYPE_CHECKING:
    import pandas as pd

#: The initializers that are preferred by default, the best first (compared in docs/method.md). The
#: first one whose data are given and that supports the model is always a candidate.
PREFERRED = ("map", "soft_es", "mean")
#: Plain means, which cost little: they are candidates, too.
MEANS = ("soft_rs", "er_avg", "soft_hybrid")
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
#: A step takes as long as so many scores of a triple, of which one has gradients.
PASSES_OF_SCORE = 6
SCORED = 8  #: Number of triples of which the work of a score is measured.
PASSES_OF_STEP = 8  #: Number of times that a step reads the vectors of triples.
READS = 4  #: The same of known queries with cross-entropy, and of likely answers.
STARTED = 0.7  #: Work of an optimum that is sought near another one, by that of the first one.
#: What a loss of MRR of earlier triples beyond the tolerance costs, in MRR about hidden entities.
PRICE = 20.0
#: Soft RS is named in a warning where it answers so much better than the selected candidate.
BETTER = 0.02
#: The MRR of earlier triples is near chance if it is below so many times that of random ranks.
NEAR_RANDOM = 2.0
REMEMBERED = 16  #: Number of selections that are kept, the last ones.
#: The compared initializers and the selection of before, by all that it depends on.
_REMEMBERED: dict[Hashable, tuple[list[Registered], Selection | None]] = {}


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
    scale: Scale  #: by which the candidates were measured
    loss_unknown: bool  #: whether the embedding's loss was to be decided, too

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
                f"{best.initializer} is the best candidate, but it harms: the MRR of earlier"
                f" triples falls by {best.loss:.3f} (tolerance {self.tolerance:g};"
                f" of trained triples from {best.h_old:.3f} to {best.h_cur:.3f})"
            )
        for mean in self.candidates:
            if mean.initializer == MEANS[0] and mean.about > best.about + BETTER:
                sentences.append(
                    f"{mean.initializer} answers questions about new entities better (MRR"
                    f" {mean.about:.3f} against {best.about:.3f} with {best.initializer}), but"
                    f" the MRR of earlier triples falls by {mean.loss:.3f}"
                )
        if self.loss_unknown and best.hidden_ends < NEAR_RANDOM * self.random_mrr:
            sentences.append(
                f"new entities will hardly ever be an answer (MRR {best.hidden_ends:.3f}): "
                "say what the embedding was trained with (loss)"
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

    The preferred ones, soft means, optima of an objective and own initializers are compared. ES, RS
    and ERS are not: this test underestimates their harm (docs/insert.md).

    Args:
        test: the hold-out test; ``has_triples``, ``has_words``: whether new entities have any.
        tolerance, budget: see ``compare``.
    """
    model, entities = test.theta0.model, test.theta0.entity.shape[1]
    method = replace(preferred(model, has_triples, has_words), trained_with=test.loss or "logistic")
    compared = [method.initializer]
    for each in suited_to(model, has_triples, has_words):
        serves = each.cost == "newton" or each.role == "own" or each.name in PREFERRED + MEANS
        if serves and each.name != method.initializer.name and not is_too_large(each, entities):
            compared.append(each)
    # of the registered function: a form that unpacks an embedding is another one at each call
    functions = tuple(id(INITIALIZERS.get(each.name, each.name).function) for each in compared)
    key = test.digest, functions, tolerance, budget
    if key not in _REMEMBERED:
        _REMEMBERED[key] = compared, compare(compared, test, tolerance, budget)
    compared, selection = _REMEMBERED[key]
    while len(_REMEMBERED) > REMEMBERED:
        del _REMEMBERED[next(iter(_REMEMBERED))]
    if selection is None:
        return method, None
    best = selection.selected
    initializer = next(each for each in compared if each.name == best.initializer)
    return Method(initializer, best.options, selection.why, selection.scale.loss), selection


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
            entities, and if these are few, that of candidates (``ordered_settings``).
    """
    work = {each.name: work_of(each, test) for each in initializers}
    settings = ordered_settings(initializers, test, work)
    first, starts = settings[0][0], test.theta0.model.linear
    scales = test.scales if first.cost == "newton" else test.scales[:1]
    each = [work[first.name]] * len(scales)
    for other, _ in settings[1:]:
        each.append(work[other.name] * (STARTED if starts and other.cost == "newton" else 1))
    # number of hidden entities that the budget allows, for each number of candidates
    possible = (budget * RATE - OVERHEAD * np.arange(1, len(each) + 1)) / np.cumsum(each)
    affordable = int((possible >= min(LEAST_HIDDEN, test.theta0.entity.shape[1])).sum())
    if not affordable:
        return None
    most_hidden = min(HIDDEN, int(possible[affordable - 1]))
    draws = test.hide(most_hidden)
    if draws is None:
        return None
    scales = scales[: 1 if affordable < len(scales) else None]
    draws, candidate = measured_with(draws, scales, settings[0], tolerance)
    others = settings[1 : affordable - len(scales) + 1]
    measured = [candidate, *(draws.measure(*setting) for setting in others)]
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
        scale=draws.context.scale,
        loss_unknown=len(test.scales) > 1,
    )


def measured_with(
    draws: HiddenDraws,
    scales: Sequence[Scale],
    setting: tuple[Registered, Mapping[str, object]],
    tolerance: float,
) -> tuple[HiddenDraws, Candidate | None]:
    """The draws, which have the first scale, with that by which an initializer with options is
    best, and its measures; with a linear score, optima are then sought near its vectors.
    """
    initializer, given = setting
    best: tuple[HiddenDraws, Candidate | None] = draws, None
    for scale in scales:
        of_scale = draws.with_scale(scale)
        inserted = of_scale.insert(initializer, given)
        if inserted is None:
            continue
        candidate = of_scale.measured(initializer.name, *inserted)
        if best[1] is None or value(candidate, tolerance) > value(best[1], tolerance):
            is_linear = draws.context.theta0.model.linear
            best = of_scale.starting_at(inserted[1]) if is_linear else of_scale, candidate
    return best


def ordered_settings(
    initializers: Sequence[Registered], test: HoldOut, work: Mapping[str, float]
) -> list[tuple[Registered, dict[str, object]]]:
    """Initializers with options, in the order in which a budget is spent: the first with its
    defaults, means by their work, the first with other options, all others.
    """
    first, *others = initializers
    others.sort(key=lambda each: work[each.name])
    cheap = [each for each in others if each.cost != "newton"]
    dear = [each for each in others if each.cost == "newton"]
    settings = [(each, dict(each.defaults)) for each in (first, *cheap)]
    settings += with_other_options(first, test)
    settings += [(each, dict(each.defaults)) for each in dear]
    for each in (*cheap, *dear):
        settings += with_other_options(each, test)
    return settings


def with_other_options(
    initializer: Registered, test: HoldOut
) -> list[tuple[Registered, dict[str, object]]]:
    """An initializer with each of the options of its ``calibration``; none if it sees words alone,
    and there are facts.
    """
    if initializer.needs == ("words",) and test.numbers.any():
        return []
    return [(initializer, {**initializer.defaults, **each}) for each in initializer.calibration]


def value(candidate: Candidate, tolerance: float) -> float:
    """The MRR about hidden entities, less ``PRICE`` times the loss beyond the tolerance."""
    return candidate.about - PRICE * max(0.0, candidate.loss - tolerance)


def select_by_rule(candidates: Sequence[Candidate], tolerance: float) -> Candidate:
    """The first with the highest ``value``."""
    values = [value(candidate, tolerance) for candidate in candidates]
    return candidates[int(np.argmax(values))]


def work_of(initializer: Registered, test: HoldOut) -> float:
    """Estimated number of multiplications for each hidden entity:
    to insert it, and to rank the queries about it.
    """
    _, entities, dimension = test.theta0.entity.shape
    ranking = 2.0 * QUERIES * entities * (dimension + 20)
    if initializer.cost == "pairs":
        return ranking + entities**2 * (1 if test.words is None else test.words.shape[1])
    if initializer.cost == "entities":
        return ranking + 4 * entities * dimension
    mean, known = float(test.numbers.mean()), len(test.triples)
    if test.scales[0].by_query:
        likely = mean * CANDIDATES
        step = 2 * CURVED * dimension + READS * (likely + min(known, KNOWN_QUERIES))
        return ranking + STEPS * step * dimension
    numbers_of_triples = mean * entities, mean * test.theta0.relation.shape[1], 2 * known
    triples = sum(min(SAMPLE, number) for number in numbers_of_triples)
    if test.theta0.model.linear:
        step = min(triples, CURVED) * dimension + PASSES_OF_STEP * triples
    else:
        by_score = multiplications(test.theta0)
        step = triples * (dimension + ELEMENTWISE + PASSES_OF_SCORE * by_score / dimension)
        ranking += 2 * QUERIES * entities * by_score
    return ranking + STEPS * step * dimension


def multiplications(theta: Embedding) -> float:
    """Multiplications of the products of matrices in the score of a triple."""
    from torch.utils.flop_counter import FlopCounterMode

    ids = torch.zeros(1, SCORED, dtype=torch.int64)
    with FlopCounterMode(display=False) as counter, torch.no_grad():
        theta.score(ids, ids, ids)
    return float(counter.get_total_flops()) / 2 / SCORED
