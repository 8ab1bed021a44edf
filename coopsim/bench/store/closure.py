"""The sources of coopsim that a run can import: what decides its result, and no others.

From the modules that run a cell, imports are followed in the text of the modules, at their head and within functions.
Two kinds are followed only where the run names them. Registered parts (policies, attacks, detectors, ...) are loaded
together by the module that registers them, and what one imports when it is used counts only for runs that use it. What
functions import from the rooms of networks counts only for runs with networks. Names of modules in quotes count as
imports, and so do all quoted names of parts: in doubt, a module counts. A run that loads another one is not stored.
"""

from __future__ import annotations

import hashlib
import os
import re
from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import coopsim

PACKAGE, FOLDER = "coopsim", Path(coopsim.__file__).parent

RUN = "coopsim.bench.engine.job"
"""The module from which all others of a cell's run are imported."""

_NETWORKS = ("coopsim.nn", "coopsim.learn")
_WEIGHTS = "weights"
_NO_DATA = ("bench", "cli", "testing")
"""Folders whose files of data no run reads: grids, templates, recipes of entries."""

_LEARNED = ("learned",)
"""Names of parts that have networks by way of another module."""

CODE_SUFFIXES = (".py", ".yaml", ".yml", ".json", ".csv", ".toml", ".safetensors", ".npz")

_TYPES = re.compile(r"^([ \t]*)if TYPE_CHECKING:\n(?:\1[ \t]+.*\n|[ \t]*\n)+", re.MULTILINE)
_IMPORT = re.compile(
    r"^([ \t]*)(?:from (coopsim[\w.]*) import (\((?:[^()#]|#[^\n]*)*\)|[^\n#]*)|import (coopsim[\w.]*))", re.MULTILINE
)
_MODULE = re.compile(r'"(coopsim(?:\.\w+)+)["{:]')
_QUOTED = re.compile(r'"([\w-]+)"')
_REGISTERED = re.compile(r'\.register\(\s*"([\w-]+)"|\balias="([\w-]+)"')
_HOME = re.compile(r'\bhome=\(?((?:\s*"[\w.]+",?)+)')
_LAZY_NAME = re.compile(r'^ +"(\w+)": "(coopsim[\w.]*)",$', re.MULTILINE)
_LAZY_NAMES = re.compile(r'\.fromkeys\(\s*\(([^()]*)\),\s*"(coopsim[\w.]*)"')


@dataclass(frozen=True, slots=True)
class Scan:
    """Imports and names in the text of a module.

    Attributes:
        digest: digest of the whole text.
        at_head: modules that it imports when it is loaded, and names of them.
        within: imports of its functions, and modules in quotes.
        registered: names that it registers.
        quoted: words in quotes.
        homes: modules that register parts for a registry that it has.
        lazy: modules of the names that it loads when they are first used.
    """

    digest: str
    at_head: tuple[tuple[str, str], ...]
    within: tuple[tuple[str, str], ...]
    registered: frozenset[str]
    quoted: frozenset[str]
    homes: frozenset[str]
    lazy: Mapping[str, str]


def scan(text: str) -> Scan:
    """Read what a module's text imports and names; what it imports for the checker of types does not count."""
    seen = _TYPES.sub("", text) if "TYPE_CHECKING" in text else text
    places: dict[bool, list[tuple[str, str]]] = {True: [], False: []}
    for indent, module, names, whole in _IMPORT.findall(seen):
        places[not indent] += [(module or whole, name) for name in ("", *_names(names))]
    is_lazy = "lazy_names(" in seen
    quoted = [] if is_lazy else [(name, "") for name in _MODULE.findall(seen)]
    return Scan(
        hashlib.sha256(text.encode()).hexdigest(),
        tuple(places[True]),
        (*places[False], *quoted),
        frozenset(name for pair in _REGISTERED.findall(seen) for name in pair if name)
        if ".register(" in seen
        else frozenset(),
        frozenset(_QUOTED.findall(seen)),
        frozenset(name for names in _HOME.findall(seen) for name in re.findall(r"[\w.]+", names))
        if "Registry" in seen
        else frozenset(),
        _lazy_in(seen) if is_lazy else {},
    )


def _lazy_in(text: str) -> dict[str, str]:
    """Return the modules of lazy names, as a package's table has them: a name a line, or several of one module."""
    grouped = {name: module for names, module in _LAZY_NAMES.findall(text) for name in _names(names)}
    return {**dict(_LAZY_NAME.findall(text)), **grouped}


def code_files(folder: Path) -> Iterator[Path]:
    """Yield the files of code and data in a folder, in order."""
    return (Path(path) for path, *_ in _states(str(folder)))


def digest_of_file(path: Path) -> str:
    """Return the digest of a file, which is read once for each state of it."""
    state = path.stat()
    return _digest_of_state(path, state.st_mtime_ns, state.st_size)


@lru_cache(maxsize=100_000)
def _digest_of_state(path: Path, _modified_ns: int, _size: int) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


def _names(imported: str) -> list[str]:
    """Return the words of what an import names, without comments."""
    return re.findall(r"\w+", re.sub(r"#[^\n]*", "", imported))


@lru_cache(maxsize=10_000)
def _scan_of(path: Path, _modified_ns: int, _size: int) -> Scan:
    return scan(path.read_text(encoding="utf-8"))


_State = tuple[str, int, int]
"""A file's path, and its time of change, ns, and bytes."""


def current_package() -> Package:
    """Return the sources of coopsim as they are now: the same object while no file has changed."""
    states = sorted(_states(str(FOLDER)), key=lambda state: state[0].split(os.sep))
    return _package_of(FOLDER, tuple(states))


def _states(folder: str) -> Iterator[_State]:
    """Yield the states of the files of code and data in a folder, by name, and then those of the folders in it.

    A walk that reads states with names takes a fifth of the time of one that asks for each. As in `os.walk`, folders
    that cannot be read have no files.
    """
    try:
        with os.scandir(folder) as found:
            entries = sorted(found, key=lambda each: each.name)
    except OSError:
        return
    folders = []
    for entry in entries:
        if entry.name.endswith(CODE_SUFFIXES):
            state = entry.stat()
            yield entry.path, state.st_mtime_ns, state.st_size
        elif entry.name != "__pycache__" and entry.is_dir():
            folders.append(entry.path)
    for inner in folders:
        yield from _states(inner)


class Package:
    """The sources of coopsim, of these states of its files.

    Attributes:
        names: names of all its modules.
    """

    def __init__(self, folder: Path, states: Iterable[_State]) -> None:
        self._folder = folder
        self._scans: dict[str, Scan] = {}
        self._data: list[Path] = []
        self._digests: dict[tuple[frozenset[str], bool], str] = {}
        self._found: dict[tuple[frozenset[str], frozenset[str], bool], frozenset[str]] = {}
        for path, modified_ns, size in states:
            if path.endswith(".py"):
                self._scans[self._name(Path(path))] = _scan_of(Path(path), modified_ns, size)
            else:
                self._data.append(Path(path))
        self._homes = {home for each in self._scans.values() for home in each.homes}
        self._parts = {name for name, each in self._scans.items() if each.registered}
        self._weights = {path.stem for path in self._data if path.suffix == ".safetensors"}

        self.names = frozenset(self._scans)

    def imported_by(self, scans: Iterable[Scan]) -> set[str]:
        """Return the modules that texts of others import."""
        return {name for each in scans for name in self._targets((*each.at_head, *each.within))}

    def named(self, words: Iterable[str]) -> frozenset[str]:
        """Return the words that are names of registered parts, or of weights."""
        parts = (name for part in self._parts for name in self._scans[part].registered)
        return frozenset(words) & {*parts, *self._weights}

    def has_networks(self, named: Collection[str]) -> bool:
        """Return whether parts and weights of these names mean networks, by what their modules import."""
        parts = [self._scans[part] for part in self._parts if self._scans[part].registered & {*named}]
        within = (module for each in parts for module, _ in each.within)
        return bool({*named} & {*self._weights, *_LEARNED}) or any(each.startswith(_NETWORKS) for each in within)

    def imports(self, roots: Iterable[str], named: Iterable[str] = (), *, networks: bool = False) -> frozenset[str]:
        """Return the modules that can be imported from some.

        Args:
            roots: modules, whose functions may all be called.
            named: names of parts that the run uses, among others.
            networks: the run may have networks.
        """
        asked = frozenset(roots), frozenset(named), networks
        if asked not in self._found:
            self._found[asked] = self._reached(*asked)
        return self._found[asked]

    def _reached(self, roots: frozenset[str], named: frozenset[str], networks: bool) -> frozenset[str]:
        used, loaded, waiting = set[str](), set[str](), [(root, True) for root in roots]
        while waiting:
            while waiting:
                module, is_used = waiting.pop()
                known = used if is_used else loaded
                if module in known or module not in self._scans:
                    continue
                known.add(module)
                waiting += [(above, False) for above in _above(module)]
                waiting += self._used(module, networks) if is_used else self._at_head(module, used=False)
            said = {*named, *(word for each in used - self._homes for word in self._scans[each].quoted)}
            waiting = [(part, True) for part in self._parts & (loaded - used) if self._scans[part].registered & said]
        return frozenset(used | loaded)

    def digest(self, modules: Iterable[str], *, networks: bool = False) -> str:
        """Digest modules, and the files of data in their folders; weights where there are networks."""
        asked = frozenset(modules), networks
        if asked not in self._digests:
            self._digests[asked] = self._digested(*asked)
        return self._digests[asked]

    def _digested(self, modules: frozenset[str], networks: bool) -> str:
        whole = hashlib.sha256()
        ordered = sorted(modules)
        for name in ordered:
            whole.update(f"{name} {self._scans[name].digest}\n".encode())
        for path in self._data:
            if self._is_read(path, ordered, networks):
                whole.update(f"{path.relative_to(self._folder).as_posix()} {digest_of_file(path)}\n".encode())
        return whole.hexdigest()

    def _is_read(self, path: Path, modules: Collection[str], networks: bool) -> bool:
        """Return whether any of the modules is in the package that a file of data is in."""
        room = path.relative_to(self._folder).parts[0]
        if room == _WEIGHTS:
            return networks
        folder = next(each for each in path.parents if (each / "__init__.py").exists())
        return room not in _NO_DATA and self._name(folder / "__init__.py") in modules

    def _used(self, module: str, networks: bool) -> Iterator[tuple[str, bool]]:
        yield from self._at_head(module, used=True)
        for name in self._targets(self._scans[module].within):
            outside = name.startswith(_NETWORKS) and not module.startswith(_NETWORKS)
            if networks or not outside:
                yield name, True

    def _at_head(self, module: str, *, used: bool) -> Iterator[tuple[str, bool]]:
        for name in self._targets(self._scans[module].at_head):
            yield name, used and not (module in self._homes and name in self._parts)

    def _targets(self, imports: Iterable[tuple[str, str]]) -> Iterator[str]:
        """Yield the modules of imports: a name may be a module's own, or that of a module within."""
        for module, name in imports:
            inner = f"{module}.{name}"
            if name and inner in self._scans:
                yield inner
            elif name and module in self._scans and name in self._scans[module].lazy:
                yield self._scans[module].lazy[name]
            yield module

    def _name(self, path: Path) -> str:
        parts = path.relative_to(self._folder).with_suffix("").parts
        return ".".join([PACKAGE, *(parts[:-1] if parts[-1] == "__init__" else parts)])


def _above(module: str) -> list[str]:
    parts = module.split(".")
    return [".".join(parts[:k]) for k in range(1, len(parts))]


@lru_cache(maxsize=1)
def _package_of(folder: Path, states: tuple[_State, ...]) -> Package:
    return Package(folder, states)
