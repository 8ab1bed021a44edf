"""The fingerprint of a cell: everything that decides its result, as text. Equal fingerprints mean equal results."""

from __future__ import annotations

import hashlib
import json
import os
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict
from functools import cache
from importlib.metadata import PackageNotFoundError, packages_distributions, version
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import coopsim
from coopsim.bench.grid.cell import Cell
from coopsim.bench.metric_spec import MetricSpec
from coopsim.bench.policy_spec import PolicySpec
from coopsim.catalog import SCENARIO_SUFFIXES
from coopsim.config.spec import parse_spec
from coopsim.config.yaml_file import path_from, read_yaml
from coopsim.errors import InvalidValueError

LAYOUT = 2
"""Raise this number when equal inputs give other results or another file."""

_PACKAGES = ("numpy", "numba", "scipy", "highway-env", "torch")
"""Packages whose versions decide bits of a result; torch, where it is installed."""

_MOST_ITEMS = 1_000_000
"""Most items of a list among options, which are all written into every cell's file."""

_CODE_SUFFIXES = (".py", ".yaml", ".yml", ".json", ".csv", ".toml", ".safetensors")


def fingerprint(
    cell: Cell,
    options: Mapping[str, Any],
    policy: PolicySpec,
    metrics: Sequence[MetricSpec] = (),
    isolation: Mapping[str, Any] | None = None,
) -> str:
    """Return everything that decides the result of a cell, as JSON with sorted keys.

    That is the cell, the options of the environment, the contents of files that they or the policy's parameters name,
    as weights of networks, and the code: coopsim's version, sources and weights, those of the package or file of a
    user's policy and metrics, and `package_versions`.

    Args:
        cell: the cell.
        options: further options of its environment; plain data.
        policy: the cell's policy.
        metrics: registered metrics whose values are in the result.
        isolation: `Isolation.as_data`; a policy in a process of its own is not imported here.

    Raises:
        InvalidValueError: an option is not plain data.
    """
    # A version alone would not do: sources under development keep theirs.
    code: dict[str, Any] = {"coopsim": {"version": coopsim.__version__, "sources": sources_digest("coopsim")}}
    place = policy.place if isolation else ""
    sources = [("policy", place or policy.policy_class().__module__, policy.source)]
    sources += [(f"metric {metric.name}", metric.module, metric.source) for metric in metrics]
    for name, module, source in sources:
        package = module.partition(".")[0]
        if source is not None:
            code[name] = _digest(source.encode())
        elif package != "coopsim":
            code[package] = {"versions": _versions(package), "sources": sources_digest(package)}
    plain = plain_options(options)
    named = (cell.condition.scenario, plain, dict(policy.parameters))
    files = {path: _digest(Path(path).read_bytes()) for path in sorted(set(_files(named)))}
    code["packages"] = package_versions()
    names = sorted(metric.name for metric in metrics)
    decided = {
        "layout": LAYOUT, "cell": asdict(cell), "options": plain, "metrics": names, "code": code, "files": files
    }  # fmt: skip
    decided |= {"isolation": dict(isolation)} if isolation else {}
    return json.dumps(decided, sort_keys=True)


@cache
def package_versions() -> Mapping[str, str]:
    """Return the versions of the packages that decide bits of a result."""
    found = dict[str, str]()
    for name in _PACKAGES:
        with suppress(PackageNotFoundError):
            found[name] = version(name)
    return found


def key_of(text: str) -> str:
    """Return the key of a fingerprint, 32 hexadecimal digits."""
    return _digest(text.encode())[:32]


def plain_options(options: Mapping[str, Any]) -> dict[str, Any]:
    """Return options as JSON has them, so that they mean the same in every process.

    Raises:
        InvalidValueError: an option is an object, such as a detector, or has too many items; the message names it.
    """
    return {name: _plain(name, value) for name, value in options.items()}


def _plain(name: str, value: Any) -> Any:
    if isinstance(value, Mapping):
        return {str(key): _plain(f"{name}.{key}", part) for key, part in value.items()}
    if name == "place_seed" and isinstance(value, range) and value and value.step == 1 and value.start >= 0:
        return f"{value.start}-{value[-1]}"  # as in files and on the command line: it may have a billion numbers
    if isinstance(value, (list, tuple, range)):
        if len(value) > _MOST_ITEMS:
            raise InvalidValueError(
                f"{name} must have at most {_MOST_ITEMS} items, got {len(value)}: for a range of places use "
                "a text like '0-999999999'"
            )
        return [_plain(name, part) for part in value]
    if isinstance(value, Path):
        return str(value)
    if value is None or isinstance(value, (bool, int, float, str)):
        return value
    raise InvalidValueError(
        f"{name} must be plain data (a number, a text, True, False, None, a list or a mapping of these), got {value!r}"
    )


def _files(value: Any, folder: str = "") -> Iterator[str]:
    """Yield the paths of files among the texts in plain data, and in the YAML files among these, relative to them.

    A text may be the spec of a part, as of a detector or an embedder, whose parameters name files.
    """
    if isinstance(value, Mapping):
        value = list(value.values())
    if isinstance(value, (list, tuple)):
        for part in value:
            yield from _files(part, folder)
    elif isinstance(value, str) and os.path.isfile(path := path_from(folder, value)):
        yield path
        if path.lower().endswith(SCENARIO_SUFFIXES):
            with suppress(InvalidValueError):  # if it is not YAML, it names no other file
                yield from _files(read_yaml(Path(path), InvalidValueError).value, os.path.dirname(path))
    elif isinstance(value, str) and value.endswith(")"):
        with suppress(InvalidValueError):  # as a place with a bracket in its name
            yield from _files(parse_spec("part", value)[1], folder)


def _versions(package: str) -> dict[str, str]:
    """Return the versions of a package's distributions; empty for a package that is on the path but not installed."""
    return {name: version(name) for name in sorted(set(packages_distributions().get(package, [])))}


@cache
def sources_digest(package: str) -> str:
    """Return a digest of the sources, data and weights of a package, 64 hexadecimal digits; it is not imported."""
    return _digest(b"\0".join(_sources(package)))


def _sources(package: str) -> Iterator[bytes]:
    module = sys.modules.get(package)
    spec = find_spec(package) if module is None else None  # of a policy in a process of its own
    roots = getattr(module, "__path__", None) if spec is None else spec.submodule_search_locations
    if roots is None:
        yield Path(str(getattr(module, "__file__", None) or (spec and spec.origin))).read_bytes()
        return
    for root in roots:
        for folder, folders, names in os.walk(root, followlinks=True):
            folders.sort()
            for name in sorted(names):
                if name.endswith(_CODE_SUFFIXES):
                    path = Path(folder, name)
                    yield path.relative_to(root).as_posix().encode()
                    yield path.read_bytes()


def _digest(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()
