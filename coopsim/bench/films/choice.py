"""The choice of what a report shows: what tells most first, and then what differs from it."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np

from coopsim.bench.films.film import Film
from coopsim.bench.films.film_file import read_film
from coopsim.bench.grid.cell import Cell, CellResult
from coopsim.errors import StoreError
from coopsim.geometry.se3 import Floats

_REPEATED = 0.5
"""Weight of what is like something that was chosen before, once for each way in which it is."""

Place = tuple[int, ...]
Alike = Callable[[Place], tuple[Any, Sequence[Any]]]


def telling(weights: Floats, alike: Alike) -> Iterator[Place]:
    """Yield the places of positive weights, the heaviest first, varied in all that is alike.

    `alike` returns the places that a chosen one takes with it, and indices of those that count half from then on.
    """
    left = weights.copy()
    while left.max(initial=0.0) > 0:
        place = tuple(int(k) for k in np.unravel_index(left.argmax(), left.shape))
        yield place
        gone, similar = alike(place)
        left[gone] = 0.0
        for each in similar:
            left[each] *= _REPEATED


class Films:
    """The films of results, each read once.

    Attributes:
        notes: lines on films that cannot be read.
    """

    def __init__(self) -> None:
        self.notes = list[str]()
        self._read: dict[Cell, Film | None] = {}

    def of(self, *results: CellResult) -> list[Film] | None:
        """Return the films of results that were filmed; None, and a note, where one cannot be read."""
        films = [self._film(each) for each in results]
        known = [each for each in films if each is not None]
        return known if len(known) == len(films) else None

    def _film(self, result: CellResult) -> Film | None:
        if result.cell not in self._read:
            try:
                self._read[result.cell] = film_of(result)
            except StoreError as error:
                self._read[result.cell] = None
                self.notes.append(str(error))
        return self._read[result.cell]


def has_film(result: CellResult) -> bool:
    """Return whether there is a film of a result, and it can be read."""
    try:
        return bool(film_of(result))
    except StoreError:
        return False


def film_of(result: CellResult) -> Film:
    """Read the film of a result.

    Raises:
        StoreError: there is none, or it is broken.
    """
    if result.film is None:
        raise StoreError(f"there is no film of {result.cell.policy}, seed {result.cell.seed}")
    film = read_film(result.film)
    if len(film.frames) != len(result.rewards):
        raise StoreError(
            f"the film {result.film.name} is broken: it has {len(film.frames)} frames, its run more or less"
        )
    return film
