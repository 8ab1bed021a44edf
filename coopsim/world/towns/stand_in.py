"""A stand-in for drawing towns: always the shipped village."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path

import yaml

from coopsim.world.custom.place import place_from
from coopsim.world.population import Population
from coopsim.world.scenario import Place
from coopsim.world.towns.town_options import TownOptions

FEWEST = Population(vehicles=10, pedestrians=4, connected_cars=3, rsus=1, drones=4)
MOST = Population(vehicles=40, pedestrians=40, connected_cars=3, rsus=1, drones=4, vans=4, buses=2, motorcycles=3,
                  bicycles=8, scooters=4, children=6, parked=40)  # fmt: skip


@lru_cache(4)
def draw_place(seed: int, options: TownOptions) -> Place:
    """Return the village."""
    import coopsim.envs

    path = Path(coopsim.envs.__file__).parent / "simulated" / "scenarios" / "village.yaml"
    return place_from(yaml.safe_load(path.read_text())["place"], f"town-{seed}")
