"""Settings and fixtures that every test shares."""

import torch
from hypothesis import settings

from tests.browser import chromium

__all__ = ["chromium"]


def pytest_make_parametrize_id(val: object, argname: str) -> str | None:
    """Bytes have the name of their argument: those that were compressed hold the time, and names must not."""
    return argname if isinstance(val, bytes) else None


settings.register_profile("isi", deadline=None, max_examples=60, derandomize=True, database=None)
settings.load_profile("isi")
torch.set_num_threads(1)
