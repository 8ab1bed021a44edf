"""Options of drawn towns: their difficulty, and the seeds of the places of episodes."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from coopsim.errors import InvalidValueError
from coopsim.support.checks import require_between, require_choice, require_count, require_flag
from coopsim.types.driving import OUTER_SIDES

MOST_JUNCTIONS = 9
MOST_LANES = 3

_END = 2**62  # all seeds are below: tables of results hold them as 64-bit integers, and ranges of them have a length
_ACCEPTED = (
    "an integer >= 0, a range or a list of these, a text like '1000-1999', or None (another for every seed); "
    "seeds below 2**62"
)


@dataclass(frozen=True, slots=True)
class TownOptions:
    """Difficulty and lights of drawn towns; None is drawn for each of them.

    Attributes:
        junctions: number of places where streets meet, roundabouts included, 1 to 9.
        openness: view past the corners, in [0, 1]: 0 is walls at the kerb, 1 wide lawns.
        lanes: most lanes a direction, 1 to 3.
        traffic_lights: lights at junctions of main roads, and where connected cars meet, except at roundabouts.
        traffic_side: side of the road that vehicles keep to, "right" or "left": a town on the left is that on the right
            in a mirror.
    """

    junctions: int | None = None
    openness: float | None = None
    lanes: int | None = None
    traffic_lights: bool = False
    traffic_side: str = "right"

    def __post_init__(self) -> None:
        require_choice("traffic_side", self.traffic_side, OUTER_SIDES)
        for name, most in (("junctions", MOST_JUNCTIONS), ("lanes", MOST_LANES)):
            if getattr(self, name) is not None:
                require_count(1, most, **{name: getattr(self, name)})
                object.__setattr__(self, name, int(getattr(self, name)))  # numpy's are no indices
        if self.openness is not None:
            require_between(0, 1, openness=self.openness)
            object.__setattr__(self, "openness", float(self.openness))
        require_flag(traffic_lights=self.traffic_lights)


@dataclass(frozen=True, slots=True)
class PlaceSeeds:
    """Seeds of drawn places.

    Attributes:
        place_seed: None: an episode with seed s is in the place of seed s. An integer: all episodes are in its place.
            A range or another sequence of N integers: an episode with seed s is in the place of number s % N among
            them, so that seeds from 0 to N - 1 give each once. Texts like "7" and "1000-1999" (both ends included)
            stand for an integer and a range, in files and on the command line.
    """

    place_seed: int | str | Sequence[int] | None = None

    def __post_init__(self) -> None:
        given: Any = self.place_seed
        if isinstance(given, str):
            given = _read(given)
        elif isinstance(given, np.ndarray) and given.ndim == 1:
            given = given.tolist()
        elif isinstance(given, np.integer):
            given = int(given)
        several = isinstance(given, (range, list, tuple))
        ends = (given[0], given[-1]) if isinstance(given, range) and given else given if several else (given,)
        if given is not None and not (len(ends) and all(_is_seed(one) for one in ends)):
            raise InvalidValueError(f"place_seed must be {_ACCEPTED}, got {self.place_seed!r}")
        object.__setattr__(self, "place_seed", tuple(map(int, given)) if isinstance(given, (list, tuple)) else given)

    def of(self, seed: int) -> int:
        """Return the seed of the place of the episode with this seed."""
        if self.place_seed is None or isinstance(self.place_seed, (int, str)):
            return int(seed if self.place_seed is None else self.place_seed)
        return self.place_seed[int(seed) % len(self.place_seed)]


def _is_seed(value: object) -> bool:
    return isinstance(value, (int, np.integer)) and not isinstance(value, bool) and 0 <= int(value) < _END


def _read(text: str) -> int | range:
    """Parse a seed, or a range of them."""
    match = re.fullmatch(r"\s*(\d+)\s*(?:-\s*(\d+)\s*)?", text)
    if match is None or (match[2] is not None and int(match[2]) < int(match[1])):
        raise InvalidValueError(f"place_seed must be {_ACCEPTED}, got {text!r}")
    return int(match[1]) if match[2] is None else range(int(match[1]), int(match[2]) + 1)
