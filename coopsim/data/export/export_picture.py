"""The picture of one exported frame: from above, with the pictures of the first agent's cameras beneath."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from coopsim.data.export.export_frame import ExportAgent, ExportFrame
from coopsim.data.files.pictures import encode_png
from coopsim.viz.bev import BevFrame, BevRenderer
from coopsim.world.snapshot import Actors, RoadMap


def frame_picture(frame: ExportFrame, road_map: RoadMap) -> bytes:
    """Return a PNG of the exported points, boxes and agents over the map, and pictures of cameras where there are any.

    Points are moved from their sensors' frames to the world by the exported poses, so a wrong pose shows.
    """
    objects = frame.objects
    count = len(objects)
    plain = np.zeros(count, np.int64), np.zeros((count, 3), np.uint8)
    actors = Actors(objects.id, objects.boxes, frame.velocity, objects.label, *plain)
    points = [
        agent.world_SE3_base.compose(scan.mounting.base_SE3_lidar).apply(scan.points)
        for agent in frame.agents
        for scan in agent.lidars.values()
    ]
    bodies = {agent.name: agent.body for agent in frame.agents}
    all_points = np.concatenate(points) if points else np.zeros((0, 3))
    renderer = BevRenderer(road_map)
    picture = renderer.draw(BevFrame(frame.time_ns, actors, bodies, all_points, {}))
    renderer.close()
    strips = [_strip(agent, picture.shape[1]) for agent in frame.agents if agent.cameras]
    return encode_png(np.concatenate([picture, *strips[:1]]))


def _strip(agent: ExportAgent, width: int) -> NDArray[np.uint8]:
    """Return an agent's pictures side by side, scaled to a width in pixels together."""
    shots = [shot.image.rgb for shot in agent.cameras.values() if shot.image.rgb is not None]
    if not shots:
        return np.zeros((0, width, 3), np.uint8)
    edges = np.linspace(0, width, len(shots) + 1).round().astype(int)
    height = max(round(shot.shape[0] * width / len(shots) / shot.shape[1]) for shot in shots)
    parts = [
        np.asarray(Image.fromarray(shot).resize((int(right - left), height)))
        for shot, left, right in zip(shots, edges[:-1], edges[1:], strict=True)
    ]
    return np.concatenate(parts, axis=1)
