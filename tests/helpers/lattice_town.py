"""A large place as a description: a lattice of streets with crossings, turned, with everything that files can have."""

from __future__ import annotations

from typing import Any

import numpy as np

_SPACING_M, _STOP_M, _HALF_M, _WALK_M, _HOUSE_M = 96.0, 18.0, 2.0, 6.5, 14.0
_OUTER_M = 78.0  # from an outer junction to its turning loop
_WAYS = np.array([[1.0, 0.0], [0.0, 1.0], [-1.0, 0.0], [0.0, -1.0]])

Cell = tuple[int, int]


def lattice_town(columns: int = 4, rows: int = 4, turn_rad: float = 0.4) -> dict[str, Any]:
    """Return a town of `columns` x `rows` junctions of four arms: with 16, 336 lanes and 100 buildings."""
    town: dict[str, Any] = {"nodes": {}, "roads": [], "starts": [], "parked": [], "buildings": [], "trees": []}
    town["walks"] = {"nodes": {}, "ways": [], "crosswalks": []}
    town["rsus"] = []
    cells = [(i, j) for i in range(columns) for j in range(rows)]
    for cell in cells:
        _add_junction(town, cell, turn_rad)
    for cell in cells:
        for arm in range(4):
            _add_street(town, cell, arm, cells, turn_rad)
    for i in range(columns + 1):
        for j in range(rows + 1):
            _add_block(town, np.array([i - 0.5, j - 0.5]) * _SPACING_M, turn_rad)
    return town


def _add_junction(town: dict[str, Any], cell: Cell, turn_rad: float) -> None:
    for arm in range(4):
        town["nodes"][_name("in", cell, arm)] = _point(cell, arm, (_STOP_M, _HALF_M), turn_rad)
        town["nodes"][_name("out", cell, arm)] = _point(cell, arm, (_STOP_M, -_HALF_M), turn_rad)
        for side, name in ((1, "left"), (-1, "right")):
            town["walks"]["nodes"][_name(name, cell, arm)] = _point(cell, arm, (14.0, side * _WALK_M), turn_rad)
            town["walks"]["nodes"][_name(f"far_{name}", cell, arm)] = _point(
                cell, arm, (_SPACING_M / 2, side * _WALK_M), turn_rad
            )
            town["walks"]["ways"].append([_name(f"far_{name}", cell, arm), _name(name, cell, arm)])
        town["walks"]["ways"].append([_name("left", cell, arm), _name("right", cell, (arm + 1) % 4)])
        town["walks"]["crosswalks"].append([_name("left", cell, arm), _name("right", cell, arm)])
        for step, turn in ((1, "right"), (2, ""), (3, "left")):
            other = (arm + step) % 4
            road: dict[str, Any] = {"from": _name("in", cell, arm), "to": _name("out", cell, other), "speed_m_s": 6.5}
            if turn:
                side = _STOP_M if turn == "right" else -_STOP_M
                road |= {"centre": _point(cell, arm, (_STOP_M, side), turn_rad), "turn": turn}
            elif arm % 2 == 0:
                road["priority"] = True
            town["roads"].append(road)
    town["rsus"].append(
        {"at": _point(cell, 0, (12.0, 12.0), turn_rad), "look_at": _point(cell, 0, (0.0, 0.0), turn_rad)}
    )


def _add_street(town: dict[str, Any], cell: Cell, arm: int, cells: list[Cell], turn_rad: float) -> None:
    """Add the lane that leads away from a junction, and at the edge of the town the loop and the lane back."""
    step = _WAYS[arm].astype(int)
    beyond = (cell[0] + int(step[0]), cell[1] + int(step[1]))
    away = [_name("out", cell, arm), _name("in", beyond, (arm + 2) % 4)]
    ways = [away]
    if beyond not in cells:
        away[1], back = _name("end", cell, arm), _name("back", cell, arm)
        town["nodes"][away[1]] = _point(cell, arm, (_OUTER_M, -_HALF_M), turn_rad)
        town["nodes"][back] = _point(cell, arm, (_OUTER_M, _HALF_M), turn_rad)
        town["roads"].append({"from": away[1], "to": back, "turn": "around"})
        ways.append([back, _name("in", cell, arm)])
    for way in ways:
        town["roads"].append({"from": way[0], "to": way[1], "speed_m_s": 11.0})
        town["starts"] += [{"road": way, "at_m": at_m, "connected": 1 + len(town["starts"])} for at_m in (14.0, 34.0)]
    heading_deg = float(np.degrees(turn_rad) + 90.0 * arm + 180.0)
    town["parked"].append({"at": _point(cell, arm, (38.0, -5.4), turn_rad), "heading_deg": round(heading_deg, 3)})
    town["trees"].append({"at": _point(cell, arm, (30.0, 10.5), turn_rad)})


def _add_block(town: dict[str, Any], middle: Any, turn_rad: float) -> None:
    """Add four buildings between streets."""
    low, high = _HOUSE_M - _SPACING_M / 2, -4.0
    for k, (sx, sy) in enumerate(((1, 1), (-1, 1), (-1, -1), (1, -1))):
        corners = np.array([[low, low], [high, low], [high, high], [low, high]]) * [sx, sy] + middle
        outline = [_rounded(corner, turn_rad) for corner in corners]
        town["buildings"].append({"outline": outline, "height_m": 8.0 + 2.0 * k})


def _name(kind: str, cell: Cell, arm: int) -> str:
    return f"{kind}_{cell[0]}_{cell[1]}_{arm}"


def _point(cell: Cell, arm: int, at: tuple[float, float], turn_rad: float) -> list[float]:
    """Return a place: along an arm of a junction and to its left."""
    along = _WAYS[arm]
    return _rounded(np.array(cell) * _SPACING_M + at[0] * along + at[1] * np.array([-along[1], along[0]]), turn_rad)


def _rounded(place: Any, turn_rad: float) -> list[float]:
    cos, sin = np.cos(turn_rad), np.sin(turn_rad)
    x, y = place
    return [round(float(cos * x - sin * y), 3), round(float(sin * x + cos * y), 3)]
