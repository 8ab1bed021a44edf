"""Run SUMO's netconvert: a network from roads of OpenStreetMap."""

from __future__ import annotations

import re
import subprocess
from collections import Counter
from pathlib import Path

from coopsim.data.maps.netconvert import MOST_LETTERS, run_netconvert
from coopsim.errors import MapFileError

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


def make_network(roads: Path, network: Path, left_hand: bool) -> tuple[str, ...]:
    """Write a network of SUMO from a file of roads, and return netconvert's warnings, a line for each kind.

    Raises:
        MissingDependencyError: netconvert is not there.
        MapFileError: it made no network, or took more than 300 s.
    """
    options = {**_OPTIONS, "osm-files": str(roads), "output-file": str(network), "lefthand": str(left_hand).lower()}
    try:
        status, said = run_netconvert(options, "maps of OpenStreetMap need netconvert of SUMO")
    except subprocess.TimeoutExpired as error:
        raise MapFileError(f"netconvert took more than {error.timeout:g} s; accepted: a smaller extract") from None
    except OSError as error:
        raise MapFileError(f"cannot run {error.filename}: {error.strerror}") from None
    if status != 0 or not network.is_file():
        errors = [line.removeprefix("Error:").strip() for line in said if line.startswith("Error:")]
        cause = errors[0][:MOST_LETTERS] if errors else f"it ended with {status}"
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
    return tuple(f"netconvert: {kind[:MOST_LETTERS].rstrip('.')}: {count}" for kind, count in counts.items())
