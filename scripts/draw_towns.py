"""Draw pictures of drawn towns to docs/results/towns: from above, and through an agent's eyes.

    python scripts/draw_towns.py [above] [close] [eyes] [options] [--places 0-23]

Every picture is of the moment after `WARM_UP_S` of traffic, place k with seed k. What stands there is drawn from the
meshes that the sensors meet.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from functools import partial
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

import coopsim
from coopsim.sensors.camera.camera import Camera
from coopsim.sensors.camera.intrinsics import Intrinsics
from coopsim.viz.point_picture import draw_points
from coopsim.viz.portrait import contact_sheet, draw_overhead
from coopsim.world.towns.options import PlaceSeeds, TownOptions
from coopsim.world.towns.scenarios import TownScenarios
from coopsim.world.world import World

Picture = NDArray[np.uint8]

FOLDER = Path(__file__).parents[1] / "docs" / "results" / "towns"
ANY = TownOptions()
WARM_UP_S = 10.0
CLOSE_M, POINTS_M = 80.0, 40.0
TILE_PX, EYES_PX = 300, (480, 300)
MARGIN_M = 15.0
LOW_AND_HIGH: dict[str, tuple[Any, Any]] = {
    "junctions": (1, 9),
    "openness": (0.0, 1.0),
    "lanes": (1, 3),
    "density": (0.5, 2.0),
}


def above(place: int, options: TownOptions = ANY, density: float = 1.0) -> Picture:
    """Draw the whole town from above."""
    world = _world(place, options, density)
    corners = np.concatenate(world.map.lanes)
    low, high = corners.min(axis=0), corners.max(axis=0)
    return draw_overhead(world, (low + high) / 2, float((high - low).max()) + 2 * MARGIN_M, TILE_PX)


def close(place: int) -> Picture:
    """Draw the surroundings of the agents from above."""
    world = _world(place, ANY, 1.0)
    agents = [body.world_SE3_base.translation[:2] for body in world.agents().values()]
    return draw_overhead(world, np.mean(agents, axis=0), CLOSE_M, TILE_PX)


def eyes(place: int, options: TownOptions = ANY, density: float = 1.0) -> Picture:
    """Draw what the first agent's camera and LiDAR see, side by side."""
    width, height = EYES_PX
    lens = Intrinsics.from_fov(2 * width, 2 * height, float(np.radians(85.0)))
    env = coopsim.parallel_env(
        "town",
        place_seed=place,
        density=density,
        junctions=options.junctions,
        openness=options.openness,
        lanes=options.lanes,
        cameras={"cav_0": [Camera("front", lens)]},
        lidar="HDL-64E",
        detector="none",
        dt_s=WARM_UP_S,
        max_cycles=2,
        expose_ground_truth=True,
    )
    policy = coopsim.make_policy("no_fusion")
    observations, _ = env.reset(seed=place)
    policy.reset(env.agent_specs, seed=place)
    observations, _, _, _, infos = env.step(policy.act(observations))
    fine = observations["cav_0"]["cameras"]["front"]["rgb"].reshape(height, 2, width, 2, 3)
    sweep, instance = observations["cav_0"]["sweeps"]["lidar"], infos["cav_0"]["instances"]["lidar"]
    points = draw_points(sweep[:, :3].astype(np.float64), instance, POINTS_M, (height, height))
    env.close()
    return np.concatenate([fine.mean(axis=(1, 3)).astype(np.uint8), points], axis=1)


def _world(place: int, options: TownOptions, density: float) -> World:
    world = World(TownScenarios(PlaceSeeds(place), options, density, None, {}).of(place), place)
    world.step(WARM_UP_S)
    return world


def _option(name: str, value: Any, place: int) -> Picture:
    """Draw a town with one option set, from above and through an agent's eyes."""
    options = ANY if name == "density" else TownOptions(**{name: value})
    density = value if name == "density" else 1.0
    views = above(place, options, density), eyes(place, options, density)[:, : EYES_PX[0]]
    picture = np.full((TILE_PX, TILE_PX + EYES_PX[0], 3), 255, dtype=np.uint8)
    picture[:, :TILE_PX], picture[: EYES_PX[1], TILE_PX:] = views
    return picture


def _save(file: Path, pictures: Sequence[tuple[str, Picture]], columns: int) -> None:
    contact_sheet(pictures, columns).save(file, quality=80, optimize=True)


VIEWS: dict[str, tuple[Callable[[int], Picture], int, int]] = {
    "above": (above, 6, 24),
    "close": (close, 6, 24),
    "eyes": (eyes, 2, 12),
}
"""Views of a place, with the columns of a sheet and the most pictures on it."""


def draw_places(folder: Path, name: str, places: Sequence[int], processes: int) -> None:
    """Draw one of `VIEWS` of all places, on sheets."""
    view, columns, a_sheet = VIEWS[name]
    with get_context("spawn").Pool(processes) as pool:
        pictures = list(tqdm(pool.imap(view, places), total=len(places), desc=name))
    labelled = [(f"place_seed={place}", picture) for place, picture in zip(places, pictures, strict=True)]
    for start in range(0, len(places), a_sheet):
        number = f"_{start // a_sheet + 1}" if len(places) > a_sheet else ""
        _save(folder / f"{name}{number}.jpg", labelled[start : start + a_sheet], columns)


def draw_options(folder: Path, place: int, processes: int) -> None:
    """Draw a low and a high value of each option, side by side."""
    values = [(name, value) for name, both in LOW_AND_HIGH.items() for value in both]
    with get_context("spawn").Pool(processes) as pool:
        pictures = pool.starmap(partial(_option, place=place), values)
    labels = [f"{name}={value}" for name, value in values]
    _save(folder / "options.jpg", list(zip(labels, pictures, strict=True)), 2)


def _places(text: str) -> range:
    first, _, last = text.partition("-")
    return range(int(first), int(last or first) + 1)


def main() -> None:
    """Read the arguments, draw."""
    parser = argparse.ArgumentParser(description="Draw pictures of drawn towns.")
    kinds = (*VIEWS, "options")
    parser.add_argument("kinds", nargs="*", help=f"of {', '.join(kinds)}; default: all")
    parser.add_argument("--places", type=_places, default=range(24), help="place seeds (default: 0-23)")
    parser.add_argument("--option-place", type=int, default=7, help="place seed of the pictures of options")
    parser.add_argument("--processes", type=int, default=1)
    parser.add_argument("--out", type=Path, default=FOLDER, help="folder of the pictures (default: %(default)s)")
    args = parser.parse_args()
    args.out.mkdir(parents=True, exist_ok=True)
    for kind in args.kinds or kinds:
        if kind == "options":
            draw_options(args.out, args.option_place, args.processes)
        else:
            draw_places(args.out, kind, args.places, args.processes)


if __name__ == "__main__":
    main()
