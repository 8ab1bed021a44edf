"""Parts that a user's script and modules have registered, as bytes for worker processes, which begin without them."""

from __future__ import annotations

import pickle
import sys
import warnings
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import cloudpickle

from coopsim.support.registry import Registry, registries
from coopsim.support.user_code import SOURCE, load_source


def added_parts() -> Iterator[tuple[Registry[Any], str, str]]:
    """Yield the parts that were registered outside the library: registry, name, and name of the registering module."""
    for registry in registries():
        for name, module in sorted(registry.added().items()):
            yield registry, name, module


def pack_registrations() -> bytes:
    """Return the parts that were registered outside the library, for `register_packed` in another process.

    Classes and functions of the script travel with their code; those of a module by its name, which the other process
    imports; the files of `file.py:Class` with their text. A part that cannot be sent is left out, with a warning.
    """
    files, parts = dict[str, str](), []
    for registry, name, module in added_parts():
        content = vars(sys.modules.get(module, sys))
        if SOURCE in content:
            files[str(content["__file__"])] = content[SOURCE]
        try:
            parts.append(cloudpickle.dumps((registry, name, registry.aliases_of(name), registry.get(name))))
        except Exception as error:  # pickling runs code of what is pickled
            warnings.warn(
                f"the {registry.kind} {name!r} cannot be sent to worker processes, which do not know it: {error}",
                stacklevel=2,
            )
    return pickle.dumps((files, parts))


def register_packed(packed: bytes) -> None:
    """Register what `pack_registrations` packed, as far as this process does not know it yet.

    What cannot be loaded here is left out, with a warning: whoever needs it says that it is unknown.
    """
    files, parts = pickle.loads(packed)
    loads: list[Callable[[], object]] = [partial(load_source, *file) for file in files.items()]
    loads += [partial(_register, part) for part in parts]
    for load in loads:
        try:
            load()
        except Exception as error:  # a module that is not here, or raises when it is imported
            warnings.warn(f"a registered part cannot be loaded in this process: {error}", stacklevel=2)


def _register(part: bytes) -> None:
    registry, name, aliases, entry = pickle.loads(part)
    if name not in registry:  # its module, once imported, has registered it
        registry.register(name, alias=next(iter(aliases), None))(entry)
