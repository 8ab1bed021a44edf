"""Planned ways that others have told, in the place of what a planner would predict of them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from coopsim.comms.uplinks.budget import nearest
from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.se3 import Floats
from coopsim.interfaces.planner import PlannedCar
from coopsim.types import Ints, Mask, Tracks
from coopsim.types.intents import Intents
from coopsim.types.taxonomy import ObjectClass

_LONG_M, _WIDE_M, _HIGH_M = 12.0, 2.5, 1.6  # of bodies that messages cannot express: more than 6 m
_FIRST_ID = 2**40  # of tracks without a number: of senders that nobody has seen


@dataclass(frozen=True, slots=True, eq=False)
class ToldWays:
    """Places of N tracks at T times, as their drivers have told them.

    Attributes:
        places: (T, N, 3) middle, m, and heading, rad, in the car's base frame; NaN: nothing was told.
        warned: (N,) flags of tracks that warn of a hard brake.
    """

    places: Floats
    warned: Mask

    @property
    def known(self) -> Mask:
        """Flags (N,) of the tracks that have told their way."""
        told: Mask = ~np.isnan(self.places[0, :, 0])
        return told

    def only(self, chosen: Mask) -> ToldWays:
        """Return those of some tracks."""
        return ToldWays(self.places[:, chosen], self.warned[chosen])


def with_intents(car: PlannedCar, times: Floats) -> tuple[PlannedCar, ToldWays]:
    """Return a car that knows what others have told: its tracks, and their ways at times (T,) s from now.

    The nearest track within 2.5 m of where a sender is takes its velocity, and the shape of its way from where the
    track is: the car's own tracks err less than the sum of two poses. A sender that is near no track becomes one.
    """
    intents, tracks = car.intents, car.tracks
    here = intents.at(np.zeros(1))[0]
    row = _rows(here, tracks)
    new = row < 0
    tracks, row[new] = _with_unseen(tracks, intents, here, new), len(tracks) + np.arange(new.sum())
    heading = here[:, 2]
    velocity = np.array(tracks.velocity)
    velocity[row] = intents.speed_m_s[:, None] * np.column_stack([np.cos(heading), np.sin(heading)])
    places, warned = np.full((len(times), len(tracks), 3), np.nan), np.zeros(len(tracks), np.bool_)
    places[:, row], warned[row] = intents.at(times), intents.hard_brake
    places[:, row, :2] += tracks.boxes.center[row, :2] - here[:, :2]
    return replace(car, tracks=replace(tracks, velocity=velocity)), ToldWays(places, warned)


def _rows(here: Floats, tracks: Tracks) -> Ints:
    """Return the track (M,) of each sender, whose place and heading (M, 3) are given; -1: none, or another's."""
    row = nearest(here[:, :2], tracks.boxes.center[:, :2])
    first = np.unique(row, return_index=True)[1]
    row[np.setdiff1d(np.arange(len(row)), first)] = -1
    return row


def _with_unseen(tracks: Tracks, intents: Intents, here: Floats, chosen: Mask) -> Tracks:
    """Return the tracks, and behind them those of the chosen (M,) senders."""
    count = int(chosen.sum())
    sizes = (intents.length_m, _LONG_M), (intents.width_m, _WIDE_M)
    length, width = (np.where(np.isnan(each), large, each)[chosen] for each, large in sizes)
    rows = [here[chosen, :2], np.full(count, _HIGH_M / 2), length, width, np.full(count, _HIGH_M), here[chosen, 2]]
    return Tracks(
        np.concatenate([tracks.id, _FIRST_ID + intents.station[chosen]]),
        Boxes3D.from_array(np.concatenate([tracks.boxes.array, np.column_stack(rows)])),
        np.concatenate([tracks.velocity, np.zeros((count, 2))]),
        np.concatenate([tracks.score, np.ones(count)]),
        np.concatenate([tracks.label, np.full(count, int(ObjectClass.CAR))]),
    )


class Known(NamedTuple):
    """Knowledge of N tracks: the times (T,) s of prediction, turn rates (N,) rad/s, belief (N,), and told ways."""

    times: Floats
    turn_rates: Floats
    belief: Floats
    told: ToldWays | None
