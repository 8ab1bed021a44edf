"""Scenarios in drawn towns, which leave as networks of SUMO."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from coopsim.data.live.demand import circuits
from coopsim.data.live.engine import SumoRun
from coopsim.data.live.episodes import WARM_S, SumoScenarios, scenario_of
from coopsim.data.logs.play.choice import Wish
from coopsim.data.maps.export.sumo.netconvert import make_network
from coopsim.data.maps.export.sumo.network import plain_files
from coopsim.data.maps.export.town_network import town_network
from coopsim.data.maps.reading import read_map
from coopsim.data.maps.street_map import StreetMap
from coopsim.world.drawn_options import PlaceSeeds, TownOptions
from coopsim.world.drawn_places import TOWN, DrawnPlaces, find_drawer
from coopsim.world.scenario import EpisodeScenarios, Place, Scenario

_TOWN_M = 2000.0  # all of it


class TownScenarios(SumoScenarios):
    """Scenarios in drawn towns, whose vehicles and people go to and fro.

    Args:
        towns: the towns, with our traffic.
        seeds: seeds of the towns.
        dt_s: time between frames.
        options: options of the towns.
    """

    def __init__(self, towns: EpisodeScenarios, seeds: PlaceSeeds, dt_s: float, options: TownOptions) -> None:
        super().__init__(seeds, dt_s)
        self.name, self._towns, self._options = towns.name, towns, options
        self.of(0)

    def _made(self, seed: int) -> Scenario:
        drawn, place_seed = self._towns.of(seed), self._seeds.of(seed)
        network, streets = _network_of(place_seed, self._options)
        run = SumoRun(network, circuits(streets, drawn.population, seed), seed, self._step_s, 0.0)
        wish = Wish(
            connected=drawn.population.connected, start_s=WARM_S, around=(0.0, 0.0), radius_m=_TOWN_M, least_s=0.0
        )
        part = self._part(run, self._look_ahead(run, wish), wish, seed)
        made = scenario_of(self.name, drawn.layout, drawn.population, drawn.detail, place_seed, part)
        return replace(made, description=drawn.description)


@lru_cache(4)
def _network_of(place_seed: int, options: TownOptions) -> tuple[str, StreetMap]:
    """Return a drawn town as a network of SUMO, and as the map that this is."""
    town = town_network(place_seed, options)
    text = make_network(plain_files(town), left_hand=town.inner_left < 0)
    with TemporaryDirectory() as folder:
        file = Path(folder, "town.net.xml")
        file.write_text(text, encoding="utf-8")
        return text, read_map(file)


class SumoTowns(DrawnPlaces):
    """Drawn towns, in which SUMO drives."""

    def __init__(self, dt_s: float) -> None:
        self._dt_s = dt_s

    def place(self, place_seed: int, options: Any) -> Place:
        return _towns().place(place_seed, options)

    def scenarios(
        self, seeds: PlaceSeeds, options: Any, density: float, detail: str | None, numbers: Mapping[str, Any]
    ) -> TownScenarios:
        return TownScenarios(_towns().scenarios(seeds, options, density, detail, numbers), seeds, self._dt_s, options)


def _towns() -> DrawnPlaces:
    towns = find_drawer(TOWN)
    assert towns is not None, "they are drawn"
    return towns
