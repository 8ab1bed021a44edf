"""Old names of modules, for one release."""

from __future__ import annotations

import importlib
import sys
import warnings
from types import ModuleType
from typing import Any


class _Moved(ModuleType):
    """Old name of a module; the new one is loaded at the first use."""

    def __init__(self, old: str, new: str) -> None:
        super().__init__(old)
        self._new = new

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__"):
            raise AttributeError(name)
        value = getattr(importlib.import_module(self._new), name)
        warnings.warn(f"{self.__name__} is now {self._new}", DeprecationWarning, stacklevel=2)
        return value


def moved(old: str, new: str) -> None:
    """Let a module be found by its old name, with a warning at each use; its parent package calls this."""
    sys.modules[old] = _Moved(old, new)
