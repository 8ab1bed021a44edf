"""Drawers of places in which SUMO drives, by the option `traffic`."""

from __future__ import annotations

from pathlib import Path

from coopsim.data.live.networks import SumoNetworks
from coopsim.data.live.towns import SumoTowns
from coopsim.errors import InvalidValueError
from coopsim.world.drawn_places import LIVE_TRAFFIC, TOWN, DrawnPlaces

_SUFFIXES = (".net.xml", ".net.xml.gz")


@LIVE_TRAFFIC.register("sumo")
def sumo_places(scenario: object, dt_s: float) -> DrawnPlaces:
    """Return what draws the places of a scenario in which SUMO drives.

    Raises:
        InvalidValueError: it is neither a network of SUMO nor "town".
    """
    if scenario == TOWN:
        return SumoTowns(dt_s)
    if isinstance(scenario, (str, Path)) and str(scenario).lower().endswith(_SUFFIXES):
        return SumoNetworks(str(scenario), dt_s)
    raise InvalidValueError(f'traffic="sumo" needs a network of SUMO (.net.xml) or {TOWN!r}, got {str(scenario)!r}')
