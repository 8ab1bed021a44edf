"""What a user may ask of a drawn town."""

from __future__ import annotations

from dataclasses import dataclass

from coopsim.support.checks import require_between, require_count

MOST_JUNCTIONS = 9
MOST_LANES = 3


@dataclass(frozen=True, slots=True)
class TownOptions:
    """Difficulty of drawn towns; what is None is drawn for each of them.

    Attributes:
        junctions: number of places where streets meet, roundabouts included, 1 to 9.
        openness: how far one can see past the corners, in [0, 1]: 0 is walls at the kerb, 1 wide lawns.
        lanes: most lanes a direction, 1 to 3.
    """

    junctions: int | None = None
    openness: float | None = None
    lanes: int | None = None

    def __post_init__(self) -> None:
        for name, most in (("junctions", MOST_JUNCTIONS), ("lanes", MOST_LANES)):
            if getattr(self, name) is not None:
                require_count(1, most, **{name: getattr(self, name)})
                object.__setattr__(self, name, int(getattr(self, name)))  # numpy's are no indices
        if self.openness is not None:
            require_between(0, 1, openness=self.openness)
            object.__setattr__(self, "openness", float(self.openness))
