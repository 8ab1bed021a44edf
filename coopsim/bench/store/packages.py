"""Packages that decide bits of results: their versions, and digests of their sources."""

from __future__ import annotations

import hashlib
import sys
from collections.abc import Iterable, Iterator, Mapping
from contextlib import suppress
from functools import cache
from importlib.metadata import PackageNotFoundError, distributions, packages_distributions, version
from importlib.util import find_spec
from pathlib import Path

from coopsim.bench.store.closure import code_files, digest_of_file
from coopsim.errors import InvalidValueError

_PACKAGES = ("numpy", "numba", "scipy", "highway-env", "embreex", "torch")
"""Packages whose versions decide bits of a result; torch, where it is installed."""


@cache
def installed_parts() -> set[tuple[str, str]]:
    """Return names and packages of all parts that installed packages add by entry points."""
    points = (point for each in distributions() for point in each.entry_points if point.group.startswith("coopsim."))
    return {(point.name, package) for point in points if (package := point.module.partition(".")[0]) != "coopsim"}


@cache
def package_versions() -> Mapping[str, str]:
    """Return the versions of the packages that decide bits of a result."""
    return installed_versions(_PACKAGES)


def installed_versions(names: Iterable[str]) -> dict[str, str]:
    """Return the versions of distributions, of those that are installed."""
    found = dict[str, str]()
    for name in names:
        with suppress(PackageNotFoundError):
            found[name] = version(name)
    return found


def versions_of(package: str) -> dict[str, str]:
    """Return the versions of a package's distributions; empty for a package that is on the path but not installed."""
    return {name: version(name) for name in sorted(set(packages_distributions().get(package, [])))}


def package_digest(package: str) -> str:
    """Return a digest of the sources, data and weights of a package as they are now, 64 hexadecimal digits."""
    return digest("\0".join(_sources(package)).encode())


def _sources(package: str) -> Iterator[str]:
    """Yield names and digests of a package's files; it need not be imported."""
    module = sys.modules.get(package)
    spec = None if module is not None else find_spec(package)
    roots = getattr(module, "__path__", None) if spec is None else spec.submodule_search_locations
    if roots is None:
        origin = spec.origin if spec is not None else getattr(module, "__file__", None)
        if origin is None:
            raise InvalidValueError(f"parts must be registered by a file, got some of {package!r}, which has none")
        roots = [origin]
    for root in roots:
        yield from files_of(Path(root))


def files_of(root: Path) -> Iterator[str]:
    """Yield the digest of a file, or names and digests of a folder's files of code and data."""
    if not root.is_dir():
        yield digest_of_file(root)
        return
    for path in code_files(root):
        yield path.relative_to(root).as_posix()
        yield digest_of_file(path)


def texts_of(path: Path) -> Iterator[str]:
    """Yield the texts of a file of code, or of those in a folder."""
    for each in code_files(path) if path.is_dir() else [path]:
        if each.suffix == ".py":
            yield each.read_text(encoding="utf-8", errors="replace")


def digest(content: bytes) -> str:
    """Return a digest of content, 64 hexadecimal digits."""
    return hashlib.sha256(content).hexdigest()
