"""numba's decorators for our kernels, which are compiled anew when any source changes that they are made of.

numba's cache looks at the file that a kernel is in. What the kernel takes from other files, it calls or it is told as a
constant, is compiled into it, and stays as it was. So our kernels are kept under a digest of their module and of all of
our modules that it imports, directly or by way of others.
"""

from __future__ import annotations

import atexit
import hashlib
import os
import re
import shutil
import stat
import tempfile
import time
import warnings
from collections.abc import Callable
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import numba
import numba.core.caching

_numba: Any = numba  # most of it has no types
_caching: Any = numba.core.caching
_Function = TypeVar("_Function", bound=Callable[..., Any])

_ROOT = Path(__file__).parents[1]
_PACKAGE = _ROOT.name
_IMPORT = re.compile(rf"^(?:from|import) +({_PACKAGE}[\w.]*)(?: +import +(\([^)]*\)|[^\n#]*))?", re.MULTILINE)
_KEPT, _KEPT_S = 4, 86400.0
"""Old versions of a module's kernels are removed but for the last few, and those of the last day: they may be in use.
"""


if TYPE_CHECKING:
    from numba import njit as njit
else:

    def njit(*functions: Any, **options: Any) -> Any:
        """Do as `numba.njit` does; nothing is kept where no folder for it is to be had."""
        return numba.njit(*functions, **_possible(options))


def vectorize(**options: Any) -> Callable[[_Function], _Function]:
    """Do as `numba.vectorize` does; nothing is kept where no folder for it is to be had."""
    decorate: Callable[[_Function], _Function] = _numba.vectorize(**_possible(options))
    return decorate


def _possible(options: dict[str, Any]) -> dict[str, Any]:
    return options if options.get("cache") is not True or _has_folder() else {**options, "cache": False}


def keep_no_kernels() -> None:
    """Read kernels that are kept, and keep no further ones, from now on in this process: it may write nothing."""
    global _writes
    _writes = False
    for memory in (_has_folder, _version_folder):
        memory.cache_clear()
    _caching.FunctionCache.save_overload = lambda *_: None
    _caching.CacheImpl._locator_classes.append(_Nowhere)


_writes = True


@lru_cache
def _has_folder() -> bool:
    return _version_folder(__file__, sources_digest(__name__)) is not None


class KernelLocator(_caching._CacheLocator):  # type: ignore[misc]
    """The place of one of our kernels in numba's cache: a folder for each version of its module."""

    def __init__(self, folder: str, digest: str, line: int) -> None:
        self._folder, self._digest, self._line = folder, digest, line

    def get_cache_path(self) -> str:
        """Return the folder."""
        return self._folder

    def get_source_stamp(self) -> str:
        """Return the digest of all that the kernel is made of."""
        return self._digest

    def get_disambiguator(self) -> str:
        """Return what tells functions of one name apart."""
        return str(self._line)

    @classmethod
    def from_function(cls, py_func: Any, py_file: str) -> KernelLocator | None:
        """Return the place of a kernel of ours; None for others, which numba keeps as usual."""
        name = py_func.__module__
        if name.partition(".")[0] != _PACKAGE or not os.path.isfile(py_file):
            return None
        digest = _current_digest(name, py_func.__globals__.get("__spec__"))
        folder = _version_folder(py_file, digest)
        return None if folder is None else cls(folder, digest, py_func.__code__.co_firstlineno)


class _Nowhere(KernelLocator):
    """The place of kernels for which no folder is to be had: none are found there."""

    @classmethod
    def from_function(cls, py_func: Any, py_file: str) -> KernelLocator | None:
        return cls(os.devnull, "", py_func.__code__.co_firstlineno)


_specs: dict[str, Any] = {}


def _current_digest(name: str, spec: Any) -> str:
    """Return the digest of a module's sources, read anew where the module is executed anew."""
    if _specs.setdefault(name, spec) is not spec:
        _specs.clear()
        for memory in (_source, _path, sources_digest):
            memory.cache_clear()
    return sources_digest(name)


@lru_cache(None)
def sources_digest(name: str) -> str:
    """Return a digest of one of our modules and of all of ours that it imports."""
    found, waiting = dict[str, bytes](), [name]
    while waiting:
        module = waiting.pop()
        if module not in found:
            found[module], imports = _source(module)
            waiting += imports
    return hashlib.sha256(b"".join(found[module] for module in sorted(found))).hexdigest()[:16]


@lru_cache(None)
def _source(name: str) -> tuple[bytes, tuple[str, ...]]:
    """Return the hash of a module's text and the names of modules that it may import; both are empty for no module."""
    path = _path(name)
    try:
        text = path.read_bytes()
    except OSError:
        return b"", ()
    imports = list[str]()
    for module, names in _IMPORT.findall(text.decode()):
        imports.append(module)
        if _path(module).name == "__init__.py":
            imports += [f"{module}.{part}" for part in re.findall(r"\w+", names)]
    return hashlib.sha256(name.encode() + text).digest(), tuple(imports)


@lru_cache(None)
def _path(name: str) -> Path:
    place = _ROOT.joinpath(*name.split(".")[1:])
    return place / "__init__.py" if place.is_dir() else place.with_suffix(".py")


@lru_cache(None)
def _version_folder(py_file: str, digest: str) -> str | None:
    """Return the folder for a version of a module's kernels, made if need be; None: there is no place for it."""
    for home in (_chosen_home, _home_in_package, _home_of_user, *((_home_for_now,) if _writes else ())):
        base = home(py_file)
        folder = base and os.path.join(base, f"{Path(py_file).stem}-{digest}")
        if folder and _is_made(folder):
            return folder
    return None


def _is_made(folder: str) -> bool:
    """Make a folder if need be, note that it is in use, and tell whether files can be written there."""
    if not _writes:
        return os.path.isdir(folder)
    try:
        if not os.path.isdir(folder):
            os.makedirs(folder, exist_ok=True)
            _remove_old(folder)
        os.utime(folder)
        tempfile.TemporaryFile(dir=folder).close()
    except OSError:
        return False
    return True


def _remove_old(folder: str) -> None:
    """Remove versions of a module's kernels that have not been in use of late."""
    base, _, _ = folder.rpartition("-")
    versions = sorted(Path(folder).parent.glob(f"{Path(base).name}-*"), key=os.path.getmtime, reverse=True)
    for version in versions[_KEPT:]:
        if os.path.getmtime(version) < time.time() - _KEPT_S:
            shutil.rmtree(version, ignore_errors=True)


def _chosen_home(py_file: str) -> str | None:
    chosen: str = _caching.config.CACHE_DIR
    return os.path.join(chosen, _subpath(py_file)) if chosen else None


def _subpath(py_file: str) -> str:
    """Return the folder below a cache's for a module's own, as numba names it."""
    subpath: str = _caching._CacheLocator.get_suitable_cache_subpath(py_file)
    return subpath


def _home_in_package(py_file: str) -> str:
    return os.path.join(os.path.dirname(py_file), "__pycache__")


def _home_of_user(py_file: str) -> str:
    base: str = _caching.AppDirs(appname="numba", appauthor=False).user_cache_dir
    return os.path.join(base, _subpath(py_file))


def _home_for_now(py_file: str) -> str | None:
    base = _temporary_home()
    return base and os.path.join(base, _subpath(py_file))


@lru_cache
def _temporary_home() -> str | None:
    """Return a folder for temporary files that nobody else can write to: reading a kept kernel runs code of it."""
    try:
        own = os.path.join(tempfile.gettempdir(), f"{_PACKAGE}-kernels-{getattr(os, 'getuid', str)()}")
        os.makedirs(own, mode=0o700, exist_ok=True)
        if not is_own_folder(own):
            own = tempfile.mkdtemp(prefix=f"{_PACKAGE}-kernels-")
            atexit.register(shutil.rmtree, own, ignore_errors=True)
    except OSError:
        own = None
    where = f"in {own}" if own else "nowhere, and compiled anew by every process"
    warnings.warn(
        f"neither the folder of {_PACKAGE} nor your home can be written to: compiled kernels are kept {where}; set "
        "NUMBA_CACHE_DIR to a folder of your own to keep them there",
        stacklevel=2,
    )
    return own


def is_own_folder(folder: str | Path) -> bool:
    """Return whether a place is a folder of this user, no link, that nobody else can write to."""
    found = os.lstat(folder)
    mine = not hasattr(os, "getuid") or found.st_uid == os.getuid()
    return stat.S_ISDIR(found.st_mode) and mine and not found.st_mode & (stat.S_IWGRP | stat.S_IWOTH)


_caching.CacheImpl._locator_classes.insert(0, KernelLocator)
