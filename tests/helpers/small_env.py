"""Options of small environments."""

from __future__ import annotations

from typing import Any

from coopsim.world.drawn_places import scenario_names

SMALL: dict[str, Any] = {
    "vehicles": 10,
    "lidar": "VLP-16",
    "lidar_columns": 256,
    "max_cycles": 12,
    "detector": "simulated",
}
"""Quick to sense, and still with agents that hear each other."""

SIMULATED = scenario_names()
