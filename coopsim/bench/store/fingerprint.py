"""The fingerprint of a cell: everything that decides its result, as text. Equal fingerprints mean equal results."""

from __future__ import annotations

import json
import os
import platform
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any

import coopsim
from coopsim.bench.grid.axis import ATTACKS
from coopsim.bench.grid.cell import Cell, scenario_options
from coopsim.bench.grid.plain_options import plain_options
from coopsim.bench.grid.policies import arithmetic_of, device_of_detector, has_network
from coopsim.bench.store.closure import RUN, Package, current_package, scan
from coopsim.bench.store.metric_spec import MetricSpec
from coopsim.bench.store.packages import (
    digest,
    files_of,
    installed_parts,
    installed_versions,
    package_digest,
    package_versions,
    texts_of,
    versions_of,
)
from coopsim.catalog import SCENARIO_SUFFIXES, PolicySpec, is_recordings_folder
from coopsim.config.spec import parse_spec
from coopsim.config.yaml_file import path_from, read_yaml
from coopsim.errors import InvalidValueError
from coopsim.interfaces.attack_option import attacks_by_agent
from coopsim.metrics.built_in import recorders_read
from coopsim.support.registrations import added_parts
from coopsim.support.user_code import modules_beside

LAYOUT = 3
"""Raise this number when equal inputs give other results or another file."""

_DRAWING = ("moderngl", "pillow")
"""Further ones that decide bits of pictures."""

_MOST_NAMES = 2**20
"""Bytes of a named file in which names of plug-ins are looked for: of weights, their description."""

_WORD = re.compile(r"[\w-]+")


def fingerprint(
    cell: Cell,
    options: Mapping[str, Any],
    policy: PolicySpec,
    metrics: Sequence[MetricSpec] = (),
    isolation: Mapping[str, Any] | None = None,
    sources: Sources | None = None,
    root: str = RUN,
) -> str:
    """Return everything that decides the result of a cell, as JSON with sorted keys.

    That is the cell, the options of the environment, the contents of files that they or the policy's parameters name,
    as weights of networks, and the code: coopsim's version, those of its sources and weights that the run can import
    (`coopsim.bench.store.closure`), the sources of the package or file of a user's policy and metrics and of all
    plug-ins that any of these name, `package_versions`, and Python's version. So is the arithmetic of networks on their
    devices and, where there are cameras, the renderer that draws. A policy in a process of its own (`isolation`) is not
    imported here.

    `sources` keeps digests for other cells of the same run. `root` is the module from which all of a run is imported.
    """
    sources, kind = sources or Sources(), None if isolation and policy.place else policy.policy_class()
    code: dict[str, Any] = {}
    named_code = [("policy", kind.__module__ if kind else policy.place, policy.source)]
    named_code += [(f"metric {metric.name}", metric.module, metric.source) for metric in metrics]
    texts, modules = list[str](), [root]
    for name, module, source in named_code:
        package = module.partition(".")[0]
        if source is not None:
            code[name] = digest(source.encode())
            beside = modules_beside(policy.place, source) if name == "policy" else ()
            code |= {f"{path.stem} beside the policy": digest("\0".join(files_of(path)).encode()) for path in beside}
            texts += [source, *(text for path in beside for text in texts_of(path))]
        elif package != "coopsim":
            code[package] = sources.described(package)
        else:
            modules.append(module)
    plain, needs = plain_options(options), getattr(kind, "needs", None)
    settings = dict(cell.condition.settings)
    lies = {agent: list(attacks) for agent, attacks in attacks_by_agent(settings.get(ATTACKS)).items()}
    named = (policy.target, cell.condition.scenario, plain, dict(policy.parameters), lies, settings)
    contents = {path: Path(path).read_bytes() for path in sorted(set(named_files(named)))}
    said = [repr((named, needs, recorders_read())).encode(), *(content[:_MOST_NAMES] for content in contents.values())]
    for package in _plug_ins(b"\n".join(said)):
        code[package] = sources.described(package)
    used = {**plain, **settings}
    networks = (kind is not None and has_network(kind)) or device_of_detector(used.get("detector")) is not None
    networks |= any(path.endswith(".safetensors") for path in contents)
    anything = any(isinstance(each, dict) for each in code.values())  # a package may import what it likes
    ours = sources.of_run(None if anything else modules, b" ".join(said).decode(errors="replace"), texts, networks)
    code["coopsim"] = {"version": coopsim.__version__, "sources": ours}
    code |= {"packages": package_versions(), "python": platform.python_version()}
    used = {**plain, **settings}
    code["arithmetic"] = arithmetic_of(policy, used.get("detector"), trusted=kind is not None)
    if kind is None or _has_cameras(cell.condition.scenario, used, needs):
        code["renderer"] = _renderer(str(used.get("renderer", "auto")))
    condition = {"scenario": cell.condition.scenario, **settings}
    decided = {
        "layout": LAYOUT,
        "cell": {"policy": cell.policy, "condition": condition, "seed": cell.seed, "frames": cell.frames},
        "options": plain,
        "metrics": sorted(metric.name for metric in metrics),
        "code": code,
        "files": {path: digest(content) for path, content in contents.items()},
    }
    decided |= {"isolation": dict(isolation)} if isolation else {}
    return json.dumps(decided, sort_keys=True)


def changed_parts(before: str, now: str) -> str:
    """Return the names of code and files in which two fingerprints of a cell differ; empty if they are the same."""
    if before == now:
        return ""
    (old, new) = ({**said["code"], **said["files"]} for said in map(json.loads, (before, now)))
    return ", ".join(sorted(name for name in old | new if old.get(name) != new.get(name))) or "an input"


class Sources:
    """The sources of packages as they are when they are first asked for: one for the cells of one run.

    Attributes:
        counted: the modules of coopsim that were found in runs.
    """

    def __init__(self) -> None:
        self._digests: dict[str, str] = {}
        self._package: Package | None = None
        self._runs: dict[tuple[frozenset[str], frozenset[str], bool], str] = {}
        self.counted = set[str]()

    def digest(self, package: str) -> str:
        """Return a digest of the sources, data and weights of a package, 64 hexadecimal digits."""
        if package not in self._digests:
            self._digests[package] = package_digest(package)
        return self._digests[package]

    def of_run(self, modules: Sequence[str] | None, said: str, texts: Sequence[str], networks: bool) -> str:
        """Return a digest of those of coopsim's sources and weights that a run can import, 64 hexadecimal digits.

        Args:
            modules: modules that the run begins from; None: it may import all.
            said: all that names parts of the run.
            texts: further code that it runs.
            networks: it has networks, whatever is said.
        """
        package = self._package = self._package or current_package()
        scans = [scan(text) for text in texts]
        roots = package.names if modules is None else {*modules, *package.imported_by(scans)}
        named = package.named(_WORD.findall(" ".join([said, *texts])))
        networks |= modules is None or bool(texts) or package.has_networks(named)
        asked = frozenset(roots), named, networks
        if asked not in self._runs:
            found = package.imports(roots, named, networks=networks)
            self.counted |= found
            self._runs[asked] = package.digest(found, networks=networks)
        return self._runs[asked]

    def uncounted(self, modules: Iterable[str]) -> list[str]:
        """Return those of coopsim's among some modules that no run of these sources was found to import."""
        known = set[str]() if self._package is None else set(self._package.names)
        return sorted(known.intersection(modules) - self.counted)

    def described(self, package: str) -> dict[str, Any]:
        """Return the versions of a package's distributions, and its digest."""
        return {"versions": versions_of(package), "sources": self.digest(package)}


def _plug_ins(said: bytes) -> list[str]:
    """Return the packages of plug-ins, of any kind, whose names are in a text: installed, or registered by a module."""
    added = {(name, module.partition(".")[0]) for _, name, module in added_parts()}
    return sorted({package for name, package in installed_parts() | added if name.encode() in said})


def key_of(text: str) -> str:
    """Return the key of a fingerprint, 32 hexadecimal digits."""
    return digest(text.encode())[:32]


def named_files(value: Any, folder: str = "") -> Iterator[str]:
    """Yield the paths of files among the texts in plain data, and in the YAML files among these, relative to them.

    A text may be the spec of a part, as of a detector or an embedder, whose parameters name files.
    """
    if isinstance(value, Mapping):
        value = list(value.values())
    if isinstance(value, (list, tuple)):
        for part in value:
            yield from named_files(part, folder)
    elif isinstance(value, str) and os.path.isfile(path := path_from(folder, value)):
        yield path
        if path.lower().endswith(SCENARIO_SUFFIXES):
            with suppress(InvalidValueError):  # if it is not YAML, it names no other file
                yield from named_files(read_yaml(Path(path), InvalidValueError).value, os.path.dirname(path))
    elif isinstance(value, str) and (value.endswith(")") or ".py:" in value):
        with suppress(InvalidValueError):  # as a place with a bracket in its name
            target, parameters = parse_spec("part", value)
            yield from named_files([target.rpartition(":")[0], parameters], folder)


def _has_cameras(scenario: str, options: Mapping[str, Any], needs: Any) -> bool:
    """Return whether images of a simulated world's cameras are drawn in a cell."""
    if is_recordings_folder(scenario):
        return False
    return bool({**scenario_options(scenario), **options}.get("cameras") or getattr(needs, "cameras", None))


@cache
def _renderer(name: str) -> dict[str, Any]:
    """Return the renderer that an option means on this machine, and the versions of the packages that it draws with."""
    from coopsim.sensors.camera.renderers import resolved_renderer

    return {"name": resolved_renderer(name), "packages": installed_versions(_DRAWING)}
