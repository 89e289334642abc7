"""Public functions compute the same under any settings of PyTorch, and leave these as they were."""

import warnings
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import AbstractContextManager, ExitStack, contextmanager
from functools import cache
from typing import Any

import numpy as np
import pytest
import torch

import isi
from isi.home.home import Home
from isi.models.losses import Loss
from isi.process import quiet
from tests.small_embedding import named
from tests.small_home import KNOWN

FACTS = [(f"thing {a}", "near", f"thing {b}") for a in range(8) for b in range(8) if (a + b) % 3]
#: Few entities with several facts: calibration trains few models.
STAR = [(f"thing {a}", "near", "thing 0") for a in range(1, 8)]
NAMED = named()
LATER = [("mug", "near", "thing 1"), ("mug", "near", "thing 2")]


@contextmanager
def changed(change: Callable[[Any], object], now: object, before: object) -> Iterator[None]:
    change(now)
    try:
        yield
    finally:
        change(before)


def settings() -> dict[str, AbstractContextManager[Any]]:
    to_dtype, to_device = torch.set_default_dtype, torch.set_default_device
    to_precision = torch.set_float32_matmul_precision
    return {
        "float64": changed(to_dtype, torch.float64, torch.float32),
        "bfloat16": changed(to_dtype, torch.bfloat16, torch.float32),
        "meta": changed(to_device, "meta", None),
        "within meta": torch.device("meta"),
        "precision": changed(to_precision, "medium", "highest"),
        "autocast": torch.autocast("cpu", dtype=torch.bfloat16),
        "inference": torch.inference_mode(),
        "no_grad": torch.no_grad(),
        "grad disabled": changed(torch.set_grad_enabled, False, True),
        "deterministic": changed(torch.use_deterministic_algorithms, True, False),
    }


def state() -> list[object]:
    device = torch.empty(0).device
    modes = torch.is_inference_mode_enabled(), torch.is_autocast_enabled("cpu")
    precision = torch.get_float32_matmul_precision()
    return [torch.get_default_dtype(), device, *modes, torch.is_grad_enabled(), precision]


def insertion() -> list[Any]:
    done = isi.insert(**NAMED)
    return [done.vectors, done.details.embedding.entity.numpy(), done.report(), done.interference()]


def training_of_new_rows() -> list[Any]:
    losses: list[Loss] = ["logistic", "softmax"]
    return [
        isi.insert(**NAMED, initializer="mean", trained_with=loss).train(epochs=2).vectors
        for loss in losses
    ]


def home() -> list[Any]:
    trained = isi.train(STAR, dimension=4, learning_rate=0.1)
    home = Home(KNOWN)
    home.tell({"mug": {"in": home.base.entity_names[0]}})
    answers = [home.ask("mug", "in"), home.nearest("mug"), home.explain("mug")]
    return [trained.base.entities, home.now.entities, *answers, home.interference()]


def benchmark() -> list[Any]:
    split = isi.benchmark.hide(FACTS, fewest=2)
    rows = np.random.default_rng(0).normal(size=(9, 4)).astype(np.float32)
    return [split.evaluate("distmult", entities=rows[:8], relations=rows[8:]).ranks]


def checks() -> list[Any]:
    return [isi.check_initializer("map"), isi.check_model("complex")]


@cache
def trained_by_pykeen() -> tuple[Any, Any]:
    models = pytest.importorskip("pykeen.models")
    triples = pytest.importorskip("pykeen.triples")
    factory = triples.TriplesFactory.from_labeled_triples(np.array(FACTS))
    return models.ComplEx(triples_factory=factory, embedding_dim=4, random_seed=0), factory


def of_pykeen() -> list[Any]:
    model, factory = trained_by_pykeen()
    inserted = isi.pykeen.insert(model, factory, LATER)
    larger, fitted = inserted.model, inserted.train(epochs=2).model
    home = isi.from_pykeen(model, factory)
    home.tell({"mug": {"near": "thing 1"}})
    made = [each for part in (larger, fitted, home.model) for each in part.parameters()]
    return [each.detach().clone().numpy() for each in made] + [home.ask("mug", "near")]


def as_bytes(values: list[Any]) -> list[bytes | str]:
    arrays = np.ndarray
    return [each.tobytes() if isinstance(each, arrays) else str(each) for each in values]


QUICK = [insertion, training_of_new_rows, benchmark, checks]
SLOW = [home, of_pykeen]  #: Seconds each.
#: For these, settings come together.
TOGETHER = [
    ("float64", "meta", "inference", "deterministic"),
    ("bfloat16", "within meta", "precision", "autocast", "no_grad", "grad disabled"),
]


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("compute", QUICK)
def test_the_callers_settings_change_no_result_and_stay(compute: Callable[[], list[Any]]) -> None:
    expected = as_bytes(compute())
    for name, setting in settings().items():
        with setting:
            before = state()
            assert as_bytes(compute()) == expected, name
            assert state() == before, name


@pytest.mark.usefixtures("quick")
@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("compute", SLOW)
def test_settings_that_come_together_change_no_result(compute: Callable[[], list[Any]]) -> None:
    assert sorted(name for names in TOGETHER for name in names) == sorted(settings())
    expected = as_bytes(compute())
    for names in TOGETHER:
        of_name = settings()
        with ExitStack() as entered:
            for name in names:
                entered.enter_context(of_name[name])
            before = state()
            assert as_bytes(compute()) == expected, names
            assert state() == before, names


@pytest.mark.usefixtures("quick")
@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("compute", [*QUICK, *SLOW])
def test_threads_under_another_default_compute_as_one_alone_and_leave_it(
    compute: Callable[[], list[Any]],
) -> None:
    expected, times = as_bytes(compute()), 3 if compute in SLOW else 8
    with changed(torch.set_default_dtype, torch.float64, torch.float32):
        with ThreadPoolExecutor(times) as threads:
            results = list(threads.map(lambda _: as_bytes(compute()), range(times)))
        assert torch.get_default_dtype() == torch.float64
    assert results == [expected] * times


def test_settings_that_threads_share_are_left_as_the_first_found_them() -> None:
    before, first, second = list(warnings.filters), ExitStack(), ExitStack()
    first.enter_context(quiet)
    second.enter_context(quiet)
    first.close()
    second.close()
    assert warnings.filters == before
