"""nuScenes' names of classes, and its tables that are the same in every export."""

from __future__ import annotations

from typing import Any

from coopsim.data.export.record_parts import token
from coopsim.types import ObjectClass

VERSION, SPLIT = "v1.0-coopsim", "all"
"""Folder of the tables, and the name of the split with all scenes in its `splits.json`."""

CATEGORIES = {
    ObjectClass.CAR: "vehicle.car",
    ObjectClass.VAN: "vehicle.car",
    ObjectClass.TRUCK: "vehicle.truck",
    ObjectClass.BUS: "vehicle.bus.rigid",
    ObjectClass.MOTORCYCLE: "vehicle.motorcycle",
    ObjectClass.BICYCLE: "vehicle.bicycle",
    ObjectClass.SCOOTER: "human.pedestrian.personal_mobility",
    ObjectClass.PEDESTRIAN: "human.pedestrian.adult",
    ObjectClass.CHILD: "human.pedestrian.child",
}
"""nuScenes' category of each class: it counts vans as cars, and does not evaluate riders of scooters."""

TRACKED = {
    ObjectClass.CAR: "car",
    ObjectClass.VAN: "car",
    ObjectClass.TRUCK: "truck",
    ObjectClass.BUS: "bus",
    ObjectClass.MOTORCYCLE: "motorcycle",
    ObjectClass.BICYCLE: "bicycle",
    ObjectClass.PEDESTRIAN: "pedestrian",
    ObjectClass.CHILD: "pedestrian",
}
"""Names in the detection and tracking tasks; other classes are not in them."""

RANGE_M = {name: 40.0 if name in ("motorcycle", "bicycle", "pedestrian") else 50.0 for name in TRACKED.values()}
"""Distance from the ego vehicle below which a class is scored."""

_ATTRIBUTES = ("vehicle.moving", "vehicle.stopped", "cycle.with_rider", "pedestrian.moving", "pedestrian.standing")

_VISIBILITY = {"1": (0, 40), "2": (40, 60), "3": (60, 80), "4": (80, 100)}

MOVING_M_S = 0.2
"""Speed from which an object counts as moving."""


def fixed_tables() -> dict[str, list[dict[str, Any]]]:
    """Return the records of category, attribute and visibility."""
    return {
        "category": [
            {"token": token("category", name), "name": name, "description": ""} for name in _distinct(CATEGORIES)
        ],
        "attribute": [{"token": token("attribute", name), "name": name, "description": ""} for name in _ATTRIBUTES],
        "visibility": [
            {"token": name, "level": f"v{low}-{high}", "description": f"{low} to {high} % of the object are visible"}
            for name, (low, high) in _VISIBILITY.items()
        ],
    }


def visibility_token(share: float) -> str:
    """Return the level of visibility of a visible share in [0, 1]."""
    return next((name for name, (_, high) in _VISIBILITY.items() if 100 * share < high), "4")


def attribute_name(label: int, speed_m_s: float) -> str:
    """Return the attribute of an object of a class; empty for the rider of a scooter."""
    category, moving = CATEGORIES[ObjectClass(label)], speed_m_s >= MOVING_M_S
    if category in ("vehicle.bicycle", "vehicle.motorcycle"):
        return "cycle.with_rider"
    if category == "human.pedestrian.personal_mobility":
        return ""
    if category.startswith("vehicle"):
        return "vehicle.moving" if moving else "vehicle.stopped"
    return "pedestrian.moving" if moving else "pedestrian.standing"


def attribute_tokens(label: int, speed_m_s: float) -> list[str]:
    """Return the tokens of an object's attribute: one, or none for the rider of a scooter."""
    name = attribute_name(label, speed_m_s)
    return [token("attribute", name)] if name else []


def camera_channel(name: str) -> str:
    """Return the channel of a camera, as CAM_BACK_LEFT of "rear_left"."""
    return f"CAM_{name.upper().replace('REAR', 'BACK')}"


def lidar_channel(name: str, position: int) -> str:
    """Return the channel of an agent's LiDAR: the first is LIDAR_TOP, which the official tools look for."""
    return "LIDAR_TOP" if position == 0 else f"LIDAR_{name.upper()}"


def scene_name(episode: str, agent: str) -> str:
    """Return the name of the scene of an agent, as "crossing_0007-cav_0"."""
    return f"{episode}-{agent}"


def sample_token(scene: str, index: int) -> str:
    """Return the token of a scene's sample, by the frame's number in the episode."""
    return token(scene, "sample", index)


def _distinct(names: dict[ObjectClass, str]) -> list[str]:
    return list(dict.fromkeys(names.values()))
