"""Calls that both kinds of vectors have: any method or attribute of the environments, and the end."""

from __future__ import annotations

import weakref
from collections.abc import Callable
from typing import Any

from coopsim.envs.vector.stepper import Stepper
from coopsim.errors import InvalidValueError


class VectorCalls:
    """Calls of the environments by name, and their end: by `close`, or when the vector is no longer used.

    Args:
        stepper: has the environments.
        end: ends their workers; must not refer to the vector.
    """

    closed: bool = False

    def __init__(self, stepper: Stepper, end: Callable[[], None]) -> None:
        self._stepper = stepper
        self._finalizer = weakref.finalize(self, end)

    def call(self, name: str, *args: Any, **keywords: Any) -> tuple[Any, ...]:
        """Call a method of every environment, or get an attribute, as `call("score")`; return the values, in order.

        Raises:
            EpisodeStateError: the vector is closed.
            Exception: what an environment raised.
            LostEnvironmentsError: a worker died.
        """
        return self._stepper.call("get", [(name, args, keywords)] * self._stepper.count)

    def get_attr(self, name: str) -> tuple[Any, ...]:
        """Return an attribute of every environment, in order; a method is called.

        Raises:
            Exception: what an environment raised, as AttributeError where there is no such attribute.
            LostEnvironmentsError: a worker died.
        """
        return self.call(name)

    def set_attr(self, name: str, values: Any) -> None:
        """Set an attribute of every environment: a list or tuple has one value for each, all else is of all.

        Raises:
            InvalidValueError: the list or tuple is of another length than the vector.
            Exception: what an environment raised.
            LostEnvironmentsError: a worker died.
        """
        count = self._stepper.count
        each = values if isinstance(values, (list, tuple)) else [values] * count
        if len(each) != count:
            raise InvalidValueError(f"values must be {count}, one for each environment, got {len(each)}")
        self._stepper.call("set", [(name, value) for value in each])

    def render(self) -> tuple[Any, ...] | None:
        """Return a picture of every environment, in order, where they were made with a `render_mode`.

        Raises:
            Exception: what an environment raised.
            LostEnvironmentsError: a worker died.
        """
        return self.call("render")

    def close(self, **_: Any) -> None:
        """Close the environments and end the workers; may be called again."""
        self.closed = True
        try:
            self._stepper.close()
        finally:
            self._finalizer()
