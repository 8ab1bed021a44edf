"""Print a digest of all that is drawn of places, a line of JSON each, to compare processors and settings.

    python scripts/place_digests.py --towns 0-23 --named > here.jsonl
    export OPENBLAS_CORETYPE=Prescott NPY_DISABLE_CPU_FEATURES="X86_V3 X86_V4 AVX512_ICL"
    python scripts/place_digests.py --towns 0-23 --named | diff here.jsonl -

A place has one digest for each part of it (roads, starts, meshes, relief, ...), so a difference names the part. With
--frames, lines tell where actors are in that many frames of traffic in the places.
"""

from __future__ import annotations

import argparse
import hashlib
import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from coopsim.cli.argument_types import seeds
from coopsim.envs.simulated.scenario_file import load_scenario_file
from coopsim.geometry.se3 import SE3
from coopsim.world.drawn_places import choose_scenarios
from coopsim.world.models import make_models
from coopsim.world.scenario import SCENARIOS, Scenario
from coopsim.world.world import World

DT_S = 0.1


def digest(content: Any) -> str:
    """Return a digest of plain data, arrays and objects of these, to the last bit; of rotations, to nine decimals."""
    found = hashlib.sha256()
    for part in _flat(content):
        found.update(part)
    return found.hexdigest()[:16]


def _flat(content: Any) -> Iterator[bytes]:
    if isinstance(content, np.ndarray) and content.dtype != object:
        yield f"{content.dtype}{content.shape}".encode()
        yield np.ascontiguousarray(content).tobytes()
    elif isinstance(content, SE3):
        yield from _flat((content.translation, np.round(content.rotation, 9) + 0.0))
    elif isinstance(content, Mapping):
        yield from _flat(list(content.items()))
    elif isinstance(content, (Sequence, set, frozenset, np.ndarray)) and not isinstance(content, (str, bytes)):
        yield f"[{len(content)}".encode()
        for each in content:
            yield from _flat(each)
    elif isinstance(content, (str, bytes, int, float, np.generic, type(None))):
        yield f"{content!r};".encode()
    elif not callable(content):
        yield type(content).__name__.encode()
        names = [name for kind in type(content).__mro__ for name in getattr(kind, "__slots__", ())]
        yield from _flat({name: getattr(content, name) for name in (*names, *getattr(content, "__dict__", ()))})


def place_digests(scenario: Scenario) -> dict[str, str]:
    """Return the digest of each part of a place with its population and description."""
    layout = {name: getattr(scenario.layout, name) for name in scenario.layout.__slots__}
    return {name: digest(part) for name, part in {**layout, "population": scenario.population}.items()} | {
        "description": digest(None if scenario.description is None else scenario.description.identity)
    }


def frame_digests(scenario: Scenario, seed: int, frames: int) -> dict[str, str]:
    """Return digests of the boxes and velocities of all actors in the first frames, the start included."""
    world, found = World(scenario, seed), {}
    for frame in range(frames):
        actors = world.actors()
        found[f"frame {frame}"] = digest((actors.boxes, actors.velocity, actors.model))
        world.step(DT_S)
    return found


def scenarios(towns: Iterable[int], *, named: bool) -> Iterator[tuple[str, Scenario, int]]:
    """Yield names, places and the seeds of their traffic."""
    drawn = choose_scenarios("town")
    for seed in towns:
        yield f"town {seed}", drawn.of(seed), seed
    village = load_scenario_file("village.yaml").scenario
    for place in [*SCENARIOS, village] if named else []:
        yield str(getattr(place, "name", place)), choose_scenarios(place, detail="full").of(0), 0


def main() -> None:
    """Print the lines that are asked for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--towns", type=seeds, default="0-23", help="seeds, as 0-23 or 0,7; default %(default)s")
    parser.add_argument("--named", action="store_true", help="also the built-in places, village.yaml and the models")
    parser.add_argument("--frames", type=int, default=0, help="of traffic to compare as well; default %(default)s")
    asked = parser.parse_args()
    for name, scenario, seed in scenarios(asked.towns, named=asked.named):
        parts = place_digests(scenario) | frame_digests(scenario, seed, asked.frames)
        print(json.dumps({"place": name, "parts": parts}), flush=True)
    if asked.named:
        print(json.dumps({"place": "models", "parts": {"models": digest(make_models(varied=True))}}))


if __name__ == "__main__":
    main()
