"""Run SUMO's netconvert: a network from roads of OpenStreetMap."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
from collections import Counter
from importlib.util import find_spec
from pathlib import Path

from coopsim.errors import MapFileError, MissingDependencyError

_INSTALL = "pip install 'coopsim[sumo]', or on Debian: apt-get install sumo"
_LONGEST_S, _MOST_LETTERS = 300.0, 200
_OPTIONS = {
    "proj.utm": "true",
    "geometry.remove": "true",  # nodes where nothing meets bend a road, and do not divide it
    "junctions.join": "true",  # nodes of one junction become one
    "osm.layer-elevation": "6",  # m that a bridge is above the road that it crosses
    "osm.sidewalks": "true",
    "osm.crossings": "true",
    "sidewalks.guess": "true",
    "crossings.guess": "true",
    "tls.guess-signals": "true",  # lights stand before a junction in OpenStreetMap, and hold for all of it
    "tls.discard-simple": "true",  # no lights where nothing crosses
    "tls.join": "true",
    "ramps.guess": "true",
    "roundabouts.guess": "true",
    "no-turnarounds.except-deadend": "true",
    "aggregate-warnings": "1",
    "xml-validation": "never",
}
_TOTAL = re.compile(r"(\d+) total messages of type: (.*)")


def is_there() -> bool:
    """Return whether netconvert is installed."""
    return _home() is not None


def _home() -> tuple[Path, dict[str, str]] | None:
    """Return netconvert and the environment that it needs: of the package `eclipse-sumo`, else on the path; or None."""
    package = find_spec("sumo")
    folder = Path(next(iter(package.submodule_search_locations or ()), "")) if package is not None else Path()
    program = folder / "bin" / "netconvert"
    if package is not None and program.is_file():
        return program, {**os.environ, "SUMO_HOME": str(folder)}
    found = shutil.which("netconvert")
    return None if found is None else (Path(found), dict(os.environ))


def make_network(roads: Path, network: Path, left_hand: bool) -> tuple[str, ...]:
    """Write a network of SUMO from a file of roads, and return netconvert's warnings, a line for each kind.

    Raises:
        MissingDependencyError: netconvert is not there.
        MapFileError: it made no network, or took more than 300 s.
    """
    home = _home()
    if home is None:
        raise MissingDependencyError(f"maps of OpenStreetMap need netconvert of SUMO: {_INSTALL}")
    program, environment = home
    options = {**_OPTIONS, "osm-files": str(roads), "output-file": str(network), "lefthand": str(left_hand).lower()}
    command = [str(program), *(word for name, value in options.items() for word in (f"--{name}", value))]
    try:
        done = subprocess.run(command, env=environment, capture_output=True, timeout=_LONGEST_S, check=False)
    except subprocess.TimeoutExpired:
        raise MapFileError(f"netconvert took more than {_LONGEST_S:g} s; accepted: a smaller extract") from None
    except OSError as error:
        raise MapFileError(f"cannot run {program}: {error.strerror}") from None
    said = done.stderr.decode(errors="replace").splitlines()
    if done.returncode != 0 or not network.is_file():
        errors = [line.removeprefix("Error:").strip() for line in said if line.startswith("Error:")]
        cause = errors[0][:_MOST_LETTERS] if errors else f"it ended with {done.returncode}"
        raise MapFileError(f"netconvert makes no network of this map ({cause}); accepted: a map with roads for cars")
    return _condensed(said)


def _condensed(said: list[str]) -> tuple[str, ...]:
    """Return warnings, a line for each kind: the first of a kind comes in full, then the number of all of them."""
    warnings = [line.removeprefix("Warning:").strip() for line in said if line.startswith("Warning:")]
    counts = Counter[str]()
    for line in warnings:
        total = _TOTAL.fullmatch(line)
        kind = total[2] if total else re.sub(r"'[^']*'|-?\d+(?:\.\d+)?", "%", line)
        counts[kind] = int(total[1]) if total else max(counts[kind], 1)
    return tuple(f"netconvert: {kind[:_MOST_LETTERS].rstrip('.')}: {count}" for kind, count in counts.items())
