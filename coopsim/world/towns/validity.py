"""Checks of drawn places that go beyond the reader's: agents that start near each other, masts at junctions with room.

The reader of places (`coopsim.world.custom.place`) refuses roads that do not meet, starts that are too close, and what
stands on a road; a place that can be made has passed these checks.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from typing import Any

import numpy as np

from coopsim.geometry import exact
from coopsim.geometry.se3 import Floats
from coopsim.world.places.layout import Layout
from coopsim.world.scenario import Scenario
from coopsim.world.world import World

AGENTS_APART_M = 80.0
AT_JUNCTION_M = 45.0
"""Distance from a mast to the nearest movement over a junction, at most."""


def fingerprint(description: Mapping[str, Any]) -> str:
    """Return a checksum of the description of a place; the order of its keys does not matter."""
    return hashlib.sha256(json.dumps(description, sort_keys=True).encode()).hexdigest()[:16]


def find_faults(scenario: Scenario, seed: int) -> list[str]:
    """Return what is wrong with a scenario, in words; nothing if all is well.

    Args:
        scenario: a place and its population.
        seed: of the episode whose start is looked at.
    """
    at = np.array([body.world_SE3_base.translation[:2] for body in World(scenario, seed).agents().values()])
    apart_m = float(exact.norm(at[:, None] - at, axis=2).max(initial=0.0))
    faults = [f"agents start {apart_m:.1f} m apart"] if apart_m > AGENTS_APART_M else []
    wanted = scenario.population.connected + scenario.population.rsus + scenario.population.drones
    if len(at) < wanted:
        faults.append(f"{wanted} agents are wanted, {len(at)} are there")
    if len(at) < 2:
        faults.append("there are fewer than two agents")
    return faults + _faults_of_masts(scenario.layout)


def _faults_of_masts(layout: Layout) -> list[str]:
    if not layout.rsus:
        return ["there is no mast"]
    lanes = [layout.network.get_lane((*road, 0)) for road in layout.movements]
    middles = np.array([lane.position(lane.length / 2, 0.0) for lane in lanes]).reshape(-1, 2)
    faults = []
    for number, pose in enumerate(layout.rsus):
        foot = pose.translation[:2]
        far_m = float(exact.norm(middles - foot, axis=1).min(initial=np.inf))
        if far_m > AT_JUNCTION_M:
            faults.append(f"mast {number} stands {far_m:.1f} m from the nearest junction")
        if any(_inside(foot, outline) for outline in layout.road_map.buildings):
            faults.append(f"mast {number} stands in a building")
    return faults


def _inside(point: Floats, outline: Floats) -> bool:
    """Return whether a point (2,) is in a convex outline (K, 2)."""
    sides, away = np.roll(outline, -1, axis=0) - outline, point - outline
    turns = sides[:, 0] * away[:, 1] - sides[:, 1] * away[:, 0]
    return bool((turns > 0).all() or (turns < 0).all())
