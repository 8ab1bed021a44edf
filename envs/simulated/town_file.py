"""Drawn towns as scenario files and as pictures from above."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from PIL import Image

from coopsim.envs.simulated.scenario_file import write_scenario_file
from coopsim.errors import InvalidValueError
from coopsim.support.files import require_writable
from coopsim.viz.overhead import draw_overhead
from coopsim.world.scenario import Scenario
from coopsim.world.towns.place_seeds import PlaceSeeds
from coopsim.world.towns.town_options import TownOptions
from coopsim.world.towns.town_scenarios import TownScenarios
from coopsim.world.world import World

PICTURES = (".png", ".jpg", ".jpeg")
"""Endings of the names of pictures."""

_MARGIN_M = 15.0
_PICTURE_PX = 900


def draw_town(place_seed: int, options: TownOptions) -> Scenario:
    """Draw a town with its usual population."""
    return TownScenarios(PlaceSeeds(place_seed), options, 1.0, None, {}).of(place_seed)


def write_town(path: Path, town: Scenario) -> Path:
    """Write a drawn town as a scenario file, whose episodes are those of the drawn one, bit by bit.

    Raises:
        InvalidValueError: it is no drawn town, or the name is not that of a scenario file.
        ScenarioFileError: the file cannot be written.
    """
    if town.description is None:
        raise InvalidValueError(f"town must be a scenario with a description, got {town.name!r}, which has none")
    if path.suffix.lower() not in (".yaml", ".yml"):
        raise InvalidValueError(f"path of a scenario file must end in .yaml, got {str(path)!r}")
    return write_scenario_file(
        path, town.description, population=town.population.numbers, options={"detail": town.detail}
    )


def require_picture(path: Path) -> None:
    """Raise `InvalidValueError` if a picture cannot be written there: to be called before it is drawn."""
    if path.suffix.lower() not in PICTURES:
        raise InvalidValueError(f"picture must end in {', '.join(PICTURES)}, got {str(path)!r}")
    require_writable(path)


def write_picture(path: Path, town: Scenario, seed: int) -> Path:
    """Draw all of a town from above at the start of the episode with this seed; agents are ringed.

    Raises:
        InvalidValueError: the file cannot be written, or its name is not that of a picture.
    """
    require_picture(path)
    corners = np.concatenate(town.layout.road_map.lanes)
    low, high = corners.min(axis=0), corners.max(axis=0)
    side_m = float((high - low).max()) + 2 * _MARGIN_M
    Image.fromarray(draw_overhead(World(town, seed), (low + high) / 2, side_m, _PICTURE_PX)).save(path)
    return path
