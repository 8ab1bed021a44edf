"""Messages of roadside units about the lights of junctions beside them: phases ten times a second, geometry once."""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from coopsim.comms.codecs.asn1 import station_id
from coopsim.comms.codecs.dsrc import MAPEM, SPATEM, encode_mapem, encode_spatem
from coopsim.errors import CodecError
from coopsim.geometry.se3 import Floats
from coopsim.types import NS_PER_S, Message, PoseEstimate

if TYPE_CHECKING:
    from coopsim.world.intersections import LitJunction

BESIDE_M = 50.0
"""Farthest from a junction's reference point that a roadside unit speaks for it."""

SPATEM_NS, MAPEM_NS = NS_PER_S // 10, NS_PER_S
"""Time between two messages about a junction; longer where frames are farther apart."""


class SignalBroadcast:
    """The messages of one episode. Each junction has the nearest unit, if one is beside it.

    Args:
        junctions: junctions with lights.
        units: names of the roadside units.
    """

    def __init__(self, junctions: Sequence[LitJunction], units: Sequence[str]) -> None:
        self._junctions, self._units = junctions, tuple(units)
        self._said: list[tuple[str, LitJunction, bytes]] | None = None
        self._before_ns: int | None = None

    def messages(
        self, time_ns: int, positions: Mapping[str, Floats], poses: Mapping[str, PoseEstimate]
    ) -> dict[str, list[Message]]:
        """Return the messages that are due, by unit; calls are in order of time.

        Args:
            time_ns: now.
            positions: true places (3,) m of agents.
            poses: estimated poses of agents, which messages carry.
        """
        if self._said is None:
            self._said = self._assigned(positions)
        found: dict[str, list[Message]] = {}
        for unit, junction, geometry in self._said:
            payloads = []
            if is_due(self._before_ns, time_ns, SPATEM_NS):
                payloads.append((encode_spatem(station_id(unit), [junction.phases(time_ns)]), SPATEM))
            if is_due(self._before_ns, time_ns, MAPEM_NS):
                payloads.append((geometry, MAPEM))
            for each in payloads:
                found.setdefault(unit, []).append(Message(unit, time_ns, poses[unit], *each))
        self._before_ns = time_ns
        return found

    def _assigned(self, positions: Mapping[str, Floats]) -> list[tuple[str, LitJunction, bytes]]:
        """Return units, each with a junction and its MAPEM. Warn of junctions that do not fit into messages."""
        assigned = []
        for junction in self._junctions:
            away_m = {unit: float(np.hypot(*(positions[unit] - junction.map.reference)[:2])) for unit in self._units}
            unit = min(away_m, key=lambda name: away_m[name], default=None)
            if unit is None or away_m[unit] > BESIDE_M:
                continue
            try:
                encode_spatem(station_id(unit), [junction.phases(0)])
                assigned.append((unit, junction, encode_mapem(station_id(unit), [junction.map])))
            except CodecError as error:
                what = f"junction {junction.map.intersection} is not broadcast by {unit}: {error}"
                warnings.warn(what, stacklevel=2)
        return assigned


def is_due(before_ns: int | None, now_ns: int, period_ns: int) -> bool:
    """Return whether a message is due that is sent once in a period; `before_ns` is the last call or None."""
    return before_ns is None or now_ns // period_ns > before_ns // period_ns
