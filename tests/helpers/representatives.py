"""Representatives of a product: those that `make test` tries, while `make check-long` tries all."""

from collections.abc import Collection, Iterable
from typing import Any

import pytest


def all_of(names: Iterable[str], *tried: str) -> list[Any]:
    """Return a parameter for each name; those that are not `tried` are marked `long`.

    One of each family suffices for every commit: the others differ from it by a row of a table or a file of weights.
    """
    names = list(names)
    unknown = set(tried) - set(names)
    assert not unknown, f"nothing is called {sorted(unknown)}; there are {names}"
    return [name if name in tried else pytest.param(name, marks=pytest.mark.long) for name in names]


def except_for(names: Iterable[str], late: Collection[str]) -> list[Any]:
    """Return a parameter for each name; those in `late` are marked `long`."""
    names = list(names)
    return all_of(names, *(name for name in names if name not in late))
