"""Methods for one and for all at once, of which a subclass may override either."""

from __future__ import annotations


def is_newer(cls: type, one: str, batch: str) -> bool:
    """Return whether a class has a newer rule for one than for all at once, which then does not know it.

    Args:
        cls: the class.
        one: the name of the method for one.
        batch: the name of the method for all at once.
    """
    place = {name: next(k for k, each in enumerate(cls.__mro__) if name in vars(each)) for name in (one, batch)}
    return place[one] < place[batch]
