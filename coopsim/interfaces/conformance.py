"""The conformance checks by the kind of part that they check."""

from __future__ import annotations

from collections.abc import Callable

from coopsim.support.registry import Registry

CONFORMANCE: Registry[Callable[..., None]] = Registry("conformance check", home="coopsim.testing")
"""Functions of `coopsim.testing` by kind, as "policy": a part goes in; nothing comes out, or `AssertionError`."""
