"""Settings and fixtures that every test shares."""

import os
import signal
from collections.abc import Iterator
from pathlib import Path

import pytest
import torch
import yaml
from hypothesis import settings

from tests.browser import chromium

__all__ = ["chromium"]

# A shell without job control starts what is in the background with Ctrl-C ignored; the processes
# that tests interrupt would inherit that.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)


def pytest_make_parametrize_id(val: object, argname: str) -> str | None:
    """Name bytes by their argument: compressed bytes contain the time,
    on which names of tests must not depend.
    """
    return argname if isinstance(val, bytes) else None


@pytest.fixture
def registries(monkeypatch: pytest.MonkeyPatch) -> None:
    """What the test registers is forgotten after it."""
    from isi.initializers.api import INITIALIZERS
    from isi.models.model import MODELS
    from isi.sources import READERS

    for plugins in (INITIALIZERS, MODELS, READERS):
        every = {name: plugins.get(name) for name in plugins.names()}
        monkeypatch.setattr(plugins, "_registered", every)


@pytest.fixture
def few_initializers(registries: None, monkeypatch: pytest.MonkeyPatch) -> None:  # noqa: ARG001
    """Only initializers that a choice compares in no time."""
    from isi.initializers.api import INITIALIZERS

    few = {name: INITIALIZERS.get(name) for name in ("mean", "soft_rs", "er_avg")}
    monkeypatch.setattr(INITIALIZERS, "_registered", few)


@pytest.fixture
def quick() -> Iterator[None]:
    """Choices of initializers are made in no time."""
    from tests.small_home import quick_choices

    with quick_choices():
        yield


@pytest.fixture
def in_tmp_path(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The test runs in a folder of its own."""
    monkeypatch.chdir(tmp_path)


#: The files that take longest.
LONGEST = (
    "test_kills",
    "test_stopping",
    "test_pipeline",
    "test_readers",
    "test_live_command",
    "test_docs",
    "test_writing",
    "test_report_page",
    "test_pipeline_extended",
)


def pytest_xdist_auto_num_workers() -> int:
    """One more than there are cores, since some tests wait for processes, browsers and timeouts."""
    return (os.cpu_count() or 1) + 1


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Begin with the longest files, so that all processes end at about the same time."""
    items.sort(key=lambda item: item.path.stem not in LONGEST)


settings.register_profile("isi", deadline=None, max_examples=60, derandomize=True, database=None)
settings.load_profile("isi")
torch.set_num_threads(1)
# by libyaml, in a tenth of the time: many tests read and change params
yaml.SafeLoader, yaml.SafeDumper = yaml.CSafeLoader, yaml.CSafeDumper  # type: ignore[misc]
