"""Named random streams: every draw belongs to one purpose of one agent.

A stream depends on `(seed, purpose, *owners)` and on nothing else, so adding an agent, a sensor or a policy
never shifts the noise of another, and the same seed gives the same bits for any number of workers.
Neither a stream nor a derived seed names the seed that it comes from.
"""

from __future__ import annotations

import hashlib
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from coopsim.errors import InvalidValueError
from coopsim.support.arrays import Floats, Ints

_GOLDEN = np.uint64(0x9E3779B97F4A7C15)
"""Increment of SplitMix64's state."""


def require_seed(seed: object) -> None:
    """Raise `InvalidValueError` unless `seed` is an integer >= 0."""
    if not isinstance(seed, (int, np.integer)) or isinstance(seed, bool) or seed < 0:
        raise InvalidValueError(f"seed must be an integer >= 0, got {seed!r}")


def stream(seed: int, purpose: str, *owners: str) -> np.random.Generator:
    """Return a generator for one purpose, such as "lidar" or "latency", of one agent (or link: sender and receiver).

    Raises:
        InvalidValueError: the seed is not an integer >= 0.
    """
    require_seed(seed)
    # A cryptographic hash, because neighbouring names ("cav_1", "cav_2") must not give related streams.
    # Names are joined by a byte that no name contains, so ("a", "bc") and ("ab", "c") differ.
    digest = hashlib.sha256("\x00".join((purpose, *owners)).encode()).digest()
    words = np.frombuffer(digest[:16], dtype="<u4").tolist()
    # Those who are handed a generator can read its `seed_seq`: there stands a digest, and the seed decides the state.
    drawn = np.random.PCG64(np.random.SeedSequence(derived_seed(seed, purpose, *owners)))
    drawn.state = np.random.PCG64(np.random.SeedSequence([int(seed), *words])).state
    return np.random.Generator(drawn)


def fresh_seed() -> int:
    """Return a random seed."""
    return int(np.random.SeedSequence().generate_state(1)[0])


def derived_seed(seed: int, purpose: str, *owners: str) -> int:
    """Return a seed for what users plug in, below 2**63: a digest of the seed, the purpose and the owners."""
    require_seed(seed)
    named = "\x00".join(("derived", str(int(seed)), purpose, *owners))
    return int.from_bytes(hashlib.sha256(named.encode()).digest()[:8], "big") >> 1


def uniform_numbers(seed: int, purpose: str, owner: Ints, count: int) -> Floats:
    """Draw (N, count) uniform numbers in [0, 1) for N owners at once, which are integers >= 0, such as ids of actors.

    A row depends on `(seed, purpose, its owner, count)` and on nothing else. The generator is SplitMix64 (Steele, Lea
    and Flood 2014), because any place of its stream can be computed by itself.
    """
    key = draw_key(seed, purpose)
    place = owner.astype(np.uint64)[:, None] * np.uint64(count) + np.arange(1, count + 1).astype(np.uint64)
    state = (key + place * _GOLDEN).astype(np.uint64)
    return (_splitmix64(state) >> np.uint64(11)).astype(np.float64) * 2.0**-53


@lru_cache(1024)  # hashing would be most of the time of a draw in every frame
def draw_key(seed: int, purpose: str) -> np.uint64:
    """Return the key that decides all of `uniform_numbers` for a purpose."""
    return np.uint64(stream(seed, purpose).integers(2**64, dtype=np.uint64))


def _splitmix64(state: NDArray[np.uint64]) -> NDArray[np.uint64]:
    """Return SplitMix64's output for each state; products wrap around."""
    mixed = (state ^ (state >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    mixed = (mixed ^ (mixed >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return mixed ^ (mixed >> np.uint64(31))
