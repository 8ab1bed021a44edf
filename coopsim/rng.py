"""Named random streams: every draw belongs to one purpose of one agent.

A stream depends on `(seed, purpose, *who)` and on nothing else, so adding an agent, a sensor or a policy
never shifts the noise of another, and the same seed gives the same bits for any number of workers.
"""

from __future__ import annotations

import hashlib

import numpy as np

from coopsim.errors import InvalidValueError


def require_seed(seed: object) -> None:
    """Raise `InvalidValueError` unless `seed` is an integer >= 0."""
    if not isinstance(seed, (int, np.integer)) or isinstance(seed, bool) or seed < 0:
        raise InvalidValueError(f"seed must be an integer >= 0, got {seed!r}")


def stream(seed: int, purpose: str, *who: str) -> np.random.Generator:
    """A generator for one purpose of one agent (or link: sender and receiver).

    Args:
        seed: the episode's seed, a non-negative integer.
        purpose: what is drawn, as "lidar", "pose", "latency".
        *who: the names that own the draw, in order.
    """
    require_seed(seed)
    # A cryptographic hash, because neighbouring names ("cav_1", "cav_2") must not give related streams.
    # Names are joined by a byte that no name contains, so ("a", "bc") and ("ab", "c") differ.
    digest = hashlib.sha256("\x00".join((purpose, *who)).encode()).digest()
    words = np.frombuffer(digest[:16], dtype="<u4").tolist()
    return np.random.default_rng(np.random.SeedSequence([int(seed), *words]))
