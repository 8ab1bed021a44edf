"""How to make an environment, in any process."""

from __future__ import annotations

import importlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cloudpickle

from coopsim.errors import InvalidValueError

Wrap = Callable[[Any], Any]


@dataclass(frozen=True, slots=True)
class Recipe:
    """What environments of a vector are made of.

    Attributes:
        environment: name or scenario file, or a function that makes one.
        agents: "all", "single" or None (which is "all"): decides how names are made.
        options: of the environment.
        wrap: wrappers, the innermost first.
    """

    environment: str | Path | Callable[..., Any]
    agents: str | None
    options: Mapping[str, Any]
    wrap: tuple[Wrap, ...]

    def make(self) -> Any:
        """Make an environment: of PettingZoo's parallel API, or of gymnasium."""
        if callable(self.environment):
            env = self.environment(**self.options)
        else:
            coopsim = importlib.import_module("coopsim")
            make = coopsim.single_env if self.agents == "single" else coopsim.parallel_env
            env = make(self.environment, **self.options)
        for wrapper in self.wrap:
            env = wrapper(env)
        return env

    def packed(self) -> bytes:
        """Return the recipe as bytes for other processes: with the functions and classes of the caller's script.

        Raises:
            InvalidValueError: a part cannot be sent.
        """
        try:
            packed: bytes = cloudpickle.dumps(self)
        except Exception as error:  # pickling runs code of what is pickled
            raise InvalidValueError(f"environment, options and wrap must be such as can be pickled: {error}") from error
        return packed
