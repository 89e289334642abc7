"""The default initializer: the best for hidden known entities, with a price on harm.

Each candidate inserts the hidden entities of the hold-out test (``isi.insertion.hidden``); the
selected one has the highest ``net_mrr``: its MRR about them, less the price of what earlier triples
lose.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from isi.errors import InputError
from isi.initializers.api import INITIALIZERS, Registered, options_of
from isi.initializers.inverses import InverseRelations, unpack_first
from isi.initializers.scale import Scale
from isi.insertion.arguments import naming_argument
from isi.insertion.engine import Method
from isi.insertion.hidden import HiddenDraws, HoldOut, Trial
from isi.models.losses import Loss, TrainingLoss, loss_named
from isi.models.model import Model

if TYPE_CHECKING:
    import pandas as pd

#: The initializers that are preferred by default, the best first (compared in docs/method.md),
#: after training with logistic loss and with another one. The first one whose data are given and
#: that supports the model is always a candidate.
AFTER_LOGISTIC, AFTER_OTHERS = ("map", "soft_es", "mean"), ("fold_in", "soft_es", "mean")
WITH_WORDS = "soft_hybrid"  #: Where training starts if there are words.
#: Plain means, which cost little: they are candidates, too.
MEANS = ("soft_rs", "er_avg", "soft_hybrid", "soft_es", "mean")
PAIRS = 2**29  #: Maximum number of word similarities of entity pairs.
LARGEST = 2**22  #: Maximum number of numbers in the vectors of entities for a comparison.
#: What a point of MRR of earlier triples costs, in points of MRR about hidden entities; and what
#: one costs beyond the harm that is allowed.
PRICE, PRICE_BEYOND = 5.0, 25.0
#: Another candidate is named in a warning where it answers so much better than the selected one.
BETTER = 0.02
#: The MRR of earlier triples is near chance if it is below so many times that of random ranks.
NEAR_RANDOM = 2.0


@dataclass(frozen=True)
class Selection:
    """The trials of the candidates for the default initializer, and that of the selected one."""

    trials: list[Trial]
    selected: Trial
    allowed: float  #: harm that is allowed: loss of MRR of earlier triples
    hidden: int  #: number of hidden entities
    queries: int  #: number of their queried triples
    random_mrr: float  #: expected MRR of earlier triples at random ranks
    loss: Loss | TrainingLoss  #: of training, by which the candidates were measured
    loss_unknown: bool  #: whether it was to be decided, too
    measured_on: str  #: where harm was measured: validation triples, or triples of training

    @property
    def why(self) -> str:
        number = len(self.trials)
        return f"the best of {number} candidates for {self.hidden} hidden known entities"

    @property
    def warnings(self) -> list[str]:
        """Sentences: even the best harms; another one answers better, at a price; the model has not
        learned its own triples.
        """
        best, sentences = self.selected, list[str]()
        if best.harm > self.allowed:
            sentences.append(
                f"{best.initializer} is the best candidate, but the MRR of earlier triples may fall"
                f" by {best.harm:.3f} (by {self.measured_on}), more than harm={self.allowed:g}"
            )
        others = [trial for trial in self.trials if trial.initializer != best.initializer]
        usable = [trial for trial in others if trial.about > best.about + BETTER]
        if usable:
            better = max(usable, key=_about)
            sentences.append(
                f"initializer={better.initializer!r} would answer questions about new entities"
                f" better (MRR {better.about:.3f} against {best.about:.3f}), but the MRR of earlier"
                f" triples may fall by {better.harm:.3f} (by {self.measured_on})"
            )
        if self.loss_unknown and best.hidden_ends < NEAR_RANDOM * self.random_mrr:
            sentences.append(
                f"new entities will hardly ever be an answer (MRR {best.hidden_ends:.3f}): "
                "say what the embedding was trained with (trained_with)"
            )
        if best.h_old < NEAR_RANDOM * self.random_mrr:
            sentences.append(
                f"the model ranks {self.measured_on} almost at random "
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
        """A row per trial: the fields of ``Trial``, number of queried triples, whether it was
        selected.
        """
        import pandas as pd

        rows = []
        for trial in self.trials:
            is_selected = trial is self.selected
            rows.append(asdict(trial) | {"queries": self.queries, "selected": is_selected})
        return pd.DataFrame(rows)


def _about(trial: Trial) -> float:
    return trial.about


def select(
    test: HoldOut, has_triples: bool, has_words: bool, *, harm: float
) -> tuple[Method, Selection | None]:
    """The default initializer, and the comparison behind it if there can be one.

    The preferred one, means, fold-in and own initializers are compared. ES, RS and ERS are not:
    this test underestimates their harm (docs/insert.md).

    Args:
        test: the hold-out test; ``has_triples``, ``has_words``: whether new entities have any.
        harm: loss of the MRR of earlier triples that is allowed.
    """
    model, entities = test.theta0.model, test.theta0.entity.shape[1]
    method = preferred(model, has_triples, has_words, test.loss)
    compared = [method.initializer]
    names = {*MEANS, *(AFTER_LOGISTIC if _may_be_logistic(test.loss) else AFTER_OTHERS), "fold_in"}
    for each in suited_to(model, has_triples, has_words):
        serves = each.role == "own" or each.name in names
        if serves and each.name != method.initializer.name and not is_too_large(each, entities):
            compared.append(each)
    is_large = test.theta0.entity.numel() > LARGEST
    selection = None if is_large else selection_among(compared, test, harm)
    if selection is None:
        return method, None
    best = selection.selected
    initializer = next(each for each in compared if each.name == best.initializer)
    return Method(initializer, best.options, selection.why, selection.loss), selection


def preferred(
    model: Model, has_triples: bool, has_words: bool, loss: Loss | TrainingLoss | None
) -> Method:
    """The first of the preferred ones for the given data, after training with a loss; None: an
    unknown one.
    """
    suited = {each.name: each for each in suited_to(model, has_triples, has_words)}
    names = AFTER_LOGISTIC if loss and _may_be_logistic(loss) else AFTER_OTHERS
    initializer = next(suited[name] for name in names if name in suited)
    why = "the best for " + " and ".join(["words"] * has_words + ["triples"] * has_triples)
    return Method(initializer, defaults_of(initializer, has_words), why, loss or "logistic")


def defaults_of(initializer: Registered, has_words: bool) -> dict[str, object]:
    """Default options; training starts from words, too, if there are any."""
    options = dict(initializer.defaults)
    if initializer.starts_from and has_words:
        options[initializer.starts_from] = WITH_WORDS
    return options


def _may_be_logistic(loss: Loss | TrainingLoss | None) -> bool:
    return loss is None or loss_named(loss).name == "logistic"


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


def selection_among(
    initializers: Sequence[Registered], test: HoldOut, harm: float
) -> Selection | None:
    """Try initializers, each with its defaults and with the options in its ``calibration``.

    None if there are too few known triples.

    Args:
        initializers: those whose needs are met by the model and the data; the loss of training,
            where it is unknown, is that by which the first one is best.
        harm: see ``select``.
    """
    methods = [method for each in initializers for method in methods_of(each, test)]
    draws = test.hide()
    if draws is None:
        return None
    draws, first = with_best_scale(draws, test.scales, methods[0], harm)
    others = [draws.trial(method) for method in methods[1:]]
    trials = [trial for trial in (first, *others) if trial is not None]
    if not trials:
        return None
    values = [net_mrr(trial, harm) for trial in trials]
    return Selection(
        trials,
        trials[int(np.argmax(values))],
        harm,
        hidden=draws.context.novel.numel(),
        queries=int(draws.about.counted.sum()),
        random_mrr=draws.random_mrr,
        loss=draws.context.scale.training,
        loss_unknown=len(test.scales) > 1,
        measured_on="triples of training" if draws.are_trained else "validation triples",
    )


def with_best_scale(
    draws: HiddenDraws, scales: Sequence[Scale], method: Method, harm: float
) -> tuple[HiddenDraws, Trial | None]:
    """The draws with that scale by which a method is best, and its trial.

    Optima of a linear score are then sought near its vectors.
    """
    best_draws, best = draws, None
    for scale in scales:
        of_scale = draws.with_scale(scale)
        inserted = of_scale.insert(method)
        if inserted is None:
            continue
        trial = of_scale.trial_of_vectors(*inserted)
        if best is None or net_mrr(trial, harm) > net_mrr(best, harm):
            best_draws, best = of_scale, trial
            if method.initializer.cost == "newton" and draws.context.theta0.model.linear:
                best_draws = of_scale.starting_at(inserted[1])
    return best_draws, best


def methods_of(initializer: Registered, test: HoldOut) -> list[Method]:
    """An initializer with its defaults, and with each of the options of its ``calibration``, unless
    it sees words alone, and there are facts.
    """
    defaults = defaults_of(initializer, test.words is not None)
    options = [defaults]
    if initializer.needs != ("words",) or not test.numbers.any():
        options += [{**defaults, **changed} for changed in initializer.calibration]
    return [Method(initializer, each, "a candidate") for each in options]


def net_mrr(trial: Trial, harm: float) -> float:
    """The MRR about hidden entities, less the price of the harm to earlier triples."""
    beyond = max(0.0, trial.harm - harm)
    return trial.about - PRICE * max(0.0, trial.harm - beyond) - PRICE_BEYOND * beyond
