"""Random streams; each depends on a root seed, a purpose and a key, not on earlier calls."""

import zlib

import numpy as np


def stream(root: int, purpose: str, *key: int) -> np.random.Generator:
    """A new generator, seeded by root seed, purpose and key (such as size, seed, epoch) alone.

    Equal arguments give equal random numbers, in any process and any order of calls.
    """
    return np.random.default_rng(np.random.SeedSequence([root, zlib.crc32(purpose.encode()), *key]))
