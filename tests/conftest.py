"""Settings and fixtures that every test shares."""

import os

import torch
from hypothesis import settings

from tests.browser import chromium

__all__ = ["chromium"]


def pytest_make_parametrize_id(val: object, argname: str) -> str | None:
    """Name bytes by their argument: compressed bytes contain the time, on which names of tests must not depend."""
    return argname if isinstance(val, bytes) else None


def pytest_xdist_auto_num_workers() -> int:
    """One more than there are cores, since some tests wait for processes, browsers and timeouts."""
    return (os.cpu_count() or 1) + 1


settings.register_profile("isi", deadline=None, max_examples=60, derandomize=True, database=None)
settings.load_profile("isi")
torch.set_num_threads(1)
