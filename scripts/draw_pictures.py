"""Draw the pictures of the pages: scenarios and situations from above, drawn towns, street furniture, places of maps.

    python scripts/draw_pictures.py [scenarios] [situations] [above] [close] [eyes] [options] [furniture] [maps]
        [--names crossing,village] [--places 0-23] [--processes 2] [--out FOLDER]

Without `--out` they go to the folders of their pages. Pictures of towns are of the moment after `WARM_UP_S` of traffic,
place k with seed k; what stands there is drawn from the meshes that the sensors meet. Maps are read from the folder
`maps` in the one that COOPSIM_DATA names; without it, `maps` is left out.
"""

from __future__ import annotations

import argparse
import os
from collections.abc import Callable, Sequence
from functools import partial
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from tqdm import tqdm

import coopsim
from coopsim.cli.argument_types import names, seeds
from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.se3 import SE3, Floats
from coopsim.sensors.camera.camera import Camera
from coopsim.sensors.camera.daylight import DAYLIGHTS, Illumination
from coopsim.sensors.camera.intrinsics import Intrinsics
from coopsim.sensors.camera.picture import FramePainter
from coopsim.sensors.camera.renderers import RaycastRenderer
from coopsim.sensors.scene import static_triangles
from coopsim.viz.bev import BevRenderer
from coopsim.viz.point_picture import draw_points
from coopsim.viz.portrait import contact_sheet, draw_overhead
from coopsim.world.drawn_places import TOWN, choose_scenarios
from coopsim.world.furniture.furnish import furnishing_parts
from coopsim.world.furniture.kinds import KINDS
from coopsim.world.places.description import MapFurniture
from coopsim.world.places.layout import flat_part, rectangle
from coopsim.world.scenario import SCENARIOS, make_scenario
from coopsim.world.situations.situation import EGO, SITUATIONS
from coopsim.world.snapshot import Actors, StaticPart
from coopsim.world.world import World

Picture = NDArray[np.uint8]

DOCS = Path(__file__).parents[1] / "docs"
FRAMES = 40
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
MAPS = {
    "Cologne": ("sumo/cologne8.net.xml", 4),
    "Ingolstadt": ("sumo/ingolstadt7.net.xml", 4),
    "Berlin-Adlershof": ("sumo/berlin_adlershof.net.xml", 0),
    "motorway A10": ("sumo/a10kw.net.xml", 0),
    "CARLA, Town03": ("opendrive/Town03.xodr.gz", 0),
    "CARLA, Town05": ("opendrive/Town05.xodr.gz", 3),
}
"""Files of maps and place seeds, by what is below the picture."""

MAP_RADIUS_M = 150.0
SMOOTHING = 2
SITUATION_SEED = 4
NONE = np.zeros(0, np.int64)
NOBODY = Actors(
    NONE, Boxes3D.from_array(np.zeros((0, 7))), np.zeros((0, 2)), NONE, NONE, np.zeros((0, 3), dtype=np.uint8)
)
GROUND = flat_part("ground", [rectangle((-500.0, 500.0), (-500.0, 500.0))], 0.0, (160, 164, 160), 0.3)


def draw_scenario(name: str, folder: Path) -> None:
    """Draw a scenario from above, with a drone, in few colours to keep the file small."""
    env = coopsim.parallel_env(name if name in SCENARIOS else f"{name}.yaml", drones=1, max_cycles=FRAMES + 1)
    coopsim.run_episode(env, coopsim.make_policy("late_fusion"), seed=3, most_steps=FRAMES)
    picture = BevRenderer(env.road_map, 720, 540).draw(env.bev_frame())
    Image.fromarray(picture).quantize(32).save(folder / f"{name}.png", optimize=True)


def above(place: int, environment: str = TOWN, **options: Any) -> Picture:
    """Draw the whole of a drawn place from above."""
    world = _world(place, environment, **options)
    corners = np.concatenate(world.map.lanes)
    low, high = corners.min(axis=0), corners.max(axis=0)
    return draw_overhead(world, (low + high) / 2, float((high - low).max()) + 2 * MARGIN_M, TILE_PX)


def close(place: int) -> Picture:
    """Draw the surroundings of the agents from above."""
    world = _world(place, TOWN)
    agents = [body.world_SE3_base.translation[:2] for body in world.agents().values()]
    return draw_overhead(world, np.mean(agents, axis=0), CLOSE_M, TILE_PX)


def eyes(place: int, environment: str = TOWN, **options: Any) -> Picture:
    """Draw what the first agent's camera and LiDAR see, side by side."""
    width, height = EYES_PX
    lens = Intrinsics.from_fov(2 * width, 2 * height, float(np.radians(85.0)))
    env = coopsim.parallel_env(
        environment,
        place_seed=place,
        cameras={"cav_0": [Camera("front", lens)]},
        lidar="HDL-64E",
        detector="none",
        dt_s=WARM_UP_S,
        max_cycles=2,
        expose_ground_truth=True,
        **options,
    )
    episode = coopsim.run_episode(env, coopsim.make_policy("no_fusion"), seed=place, most_steps=1)
    observations, infos = episode.observations, episode.infos
    fine = observations["cav_0"]["cameras"]["front"]["rgb"].reshape(height, 2, width, 2, 3)
    sweep, instance = observations["cav_0"]["sweeps"]["lidar"], infos["cav_0"]["instances"]["lidar"]
    points = draw_points(sweep[:, :3].astype(np.float64), instance, POINTS_M, (height, height))
    env.close()
    return np.concatenate([fine.mean(axis=(1, 3)).astype(np.uint8), points], axis=1)


def _world(place: int, environment: str, **options: Any) -> World:
    world = World(choose_scenarios(environment, place_seed=place, **options).of(place), place)
    world.step(WARM_UP_S)
    return world


def _option(name: str, value: Any, place: int) -> Picture:
    """Draw a town with one option set, from above and through an agent's eyes."""
    views = above(place, **{name: value}), eyes(place, **{name: value})[:, : EYES_PX[0]]
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


def draw_maps(folder: Path) -> None:
    """Draw places of maps from above and in the first agent's LiDAR, side by side."""
    pictures = []
    for name, (file, place) in MAPS.items():
        path = str(Path(os.environ["COOPSIM_DATA"]) / "maps" / file)
        points = eyes(place, path, radius_m=MAP_RADIUS_M)[:, EYES_PX[0] :]
        pictures.append((name, np.hstack([above(place, path, radius_m=MAP_RADIUS_M), points])))
    _save(folder / "maps.jpg", pictures, 2)


def axes_towards(yaw_deg: float, down_deg: float) -> Floats:
    """Return the axes (3, 3) of a camera that looks in a direction."""
    yaw, down = np.radians([yaw_deg, down_deg])
    ahead = np.array([np.cos(yaw) * np.cos(down), np.sin(yaw) * np.cos(down), -np.sin(down)])
    right = np.array([np.sin(yaw), -np.cos(yaw), 0.0])
    return np.column_stack([right, np.cross(ahead, right), ahead])


def photograph(
    parts: list[StaticPart], world_SE3_camera: SE3, fov_deg: float, size_px: tuple[int, int]
) -> NDArray[np.uint8]:
    """Return a picture (H, W, 3) of meshes."""
    width, height = size_px
    lens = Intrinsics.from_fov(width * SMOOTHING, height * SMOOTHING, np.radians(fov_deg))
    triangles = static_triangles(parts)
    renderer, painter = RaycastRenderer(), FramePainter(Illumination(DAYLIGHTS.get("day")), ["rgb"])
    renderer.update(triangles)
    painter.update(NOBODY, triangles)
    rgb = painter.paint(renderer.see(Camera("camera", lens), world_SE3_camera, None), lens).rgb
    assert rgb is not None, "asked for above"
    fine = rgb.reshape(height, SMOOTHING, width, SMOOTHING, 3)
    return fine.mean(axis=(1, 3)).astype(np.uint8)  # type: ignore[no-any-return]


def portrait(kind: str) -> tuple[str, NDArray[np.uint8]]:
    """Return a kind's caption and its picture, from its front left."""
    step_m = KINDS[kind].step_m
    where: dict[str, Any] = {"at": (0.0, 0.0), "heading_deg": 0.0}
    if step_m:
        where = {"along": ((0.0, 0.0), (max(step_m, 6.0), 0.0))}
    parts = furnishing_parts([MapFurniture(kind, **where)])
    points = np.concatenate([part.vertices for part in parts])
    low, high = points.min(axis=0), points.max(axis=0)
    axes = axes_towards(215.0, 12.0)
    away_m = np.linalg.norm(high - low) / 2 / np.sin(np.radians(10.3))
    pose = SE3(axes, (low + high) / 2 - away_m * axes[:, 2])
    faces = sum(len(part.faces) for part in parts)
    return f"{kind}: {faces} triangles", photograph([GROUND, *parts], pose, 30.0, (200, 150))


def street(name: str, spot: tuple[float, float, float], yaw_deg: float, down_deg: float) -> NDArray[np.uint8]:
    """Return a picture of a scenario in full detail, without actors."""
    pose = SE3(axes_towards(yaw_deg, down_deg), np.array(spot))
    return photograph(list(make_scenario(name, detail="full").static), pose, 75.0, (500, 300))


def draw_furniture(folder: Path) -> None:
    """Draw all kinds of street furniture and plants on a sheet, and two furnished streets."""
    contact_sheet([portrait(kind) for kind in KINDS], columns=5).save(folder / "furniture.png", optimize=True)
    streets = [
        street("parking_street", (30.0, 2.0, 6.0), 180.0, 10.0),
        street("urban_grid", (-60.0, 98.0, 1.8), 0.0, 3.0),
    ]
    Image.fromarray(np.hstack(streets)).save(folder / "furnished_streets.png", optimize=True)


def draw_situations(folder: Path) -> None:
    """Draw every situation from above, around the ego, two seconds before it meets what it cannot see."""
    pictures = []
    for name in SITUATIONS.names():
        scenario = SITUATIONS.get(name)(penetration=0.0).of(SITUATION_SEED)
        before = _until_crash(World(scenario, SITUATION_SEED, control="acceleration", driven=[EGO])) - 2.0
        world = World(scenario, SITUATION_SEED, control="acceleration", driven=[EGO])
        for _ in range(round(before / 0.1)):
            world.step(0.1, {EGO: 0.0})
        pose = world.agents()[EGO].world_SE3_base
        pictures.append((name, draw_overhead(world, pose.apply(np.array([[18.0, 0.0, 0.0]]))[0, :2], 64.0, TILE_PX)))
    sheet = contact_sheet(pictures, columns=4)
    sheet.quantize(64).save(folder / "situations.png", optimize=True)


def _until_crash(world: World) -> float:
    """Return the time, in s, at which the ego crashes if it goes on."""
    ego, steps = world.agents()[EGO].actor_id, 0
    while ego not in world.crashed() and steps < 100:
        world.step(0.1, {EGO: 0.0})
        steps += 1
    return 0.1 * steps


PAGES = {
    "scenarios": DOCS / "reference" / "scenarios",
    "situations": DOCS / "reference",
    "furniture": DOCS / "reference",
    **dict.fromkeys((*VIEWS, "options"), DOCS / "results" / "towns"),
    **({"maps": DOCS / "gallery"} if "COOPSIM_DATA" in os.environ else {}),
}
"""The pictures, and the folders of their pages."""


def main() -> None:
    """Read the arguments, draw."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("pictures", nargs="*", help=f"of {', '.join(PAGES)}; default: all")
    parser.add_argument("--names", type=names, default=(*SCENARIOS, "village"), help="of scenarios (default: all)")
    parser.add_argument("--places", type=seeds, default="0-23", help="place seeds (default: %(default)s)")
    parser.add_argument("--option-place", type=int, default=7, help="place seed of the pictures of options")
    parser.add_argument("--processes", type=int, default=1)
    parser.add_argument("--out", type=Path, help="folder of the pictures (default: their pages')")
    given = parser.parse_args()
    for kind in given.pictures or PAGES:
        folder = given.out or PAGES[kind]
        folder.mkdir(parents=True, exist_ok=True)
        if kind == "scenarios":
            for name in given.names:
                draw_scenario(name, folder)
        elif kind == "situations":
            draw_situations(folder)
        elif kind == "furniture":
            draw_furniture(folder)
        elif kind == "maps":
            draw_maps(folder)
        elif kind == "options":
            draw_options(folder, given.option_place, given.processes)
        else:
            draw_places(folder, kind, given.places, given.processes)


if __name__ == "__main__":
    main()
