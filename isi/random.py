"""Random streams, keyed by their purpose and never by what ran before them."""

import zlib

import numpy as np


def stream(root: int, purpose: str, *key: int) -> np.random.Generator:
    """A generator that depends on its key alone.

    Two calls with the same root seed, purpose and key (size, seed, epoch, ...) draw the same
    numbers, whatever else was drawn, in whatever order and in whichever process.
    """
    return np.random.default_rng(np.random.SeedSequence([root, zlib.crc32(purpose.encode()), *key]))
