"""The pictures of a clip's agents."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from coopsim.learn.clips.clip import BLOCK, Picture
from coopsim.learn.rollout.clip_world import ClipWorld
from coopsim.sensors.camera.camera_rig import CameraRig
from coopsim.sensors.camera.daylight import DAYLIGHTS, Illumination
from coopsim.sensors.camera.picture import MODES, NO_CLASS
from coopsim.sensors.camera.renderers.choice import make_renderer
from coopsim.sensors.lidar.tally import count_instances
from coopsim.sensors.scene import Triangles
from coopsim.types import CameraCalibration, CameraImage, Ints
from coopsim.world.snapshot import Actors, AgentBody


class ClipPictures:
    """Photographs a clip, frame by frame, from the thread in which it was made. Close it at the clip's end.

    Args:
        drawn: says which cameras, weather and time of day.
        bodies: the agents, by name.
    """

    def __init__(self, drawn: ClipWorld, bodies: Mapping[str, AgentBody]) -> None:
        rigs = {name: drawn.cameras[body.kind] for name, body in bodies.items()}
        self._calibrations = {
            name: [camera.calibration(bodies[name].height_m) for camera in cameras] for name, cameras in rigs.items()
        }
        light = Illumination(DAYLIGHTS.get(drawn.time_of_day), drawn.weather)
        self._rig = CameraRig(rigs, make_renderer(_renderer_here()), modes=MODES, illumination=light)

    def take(
        self, triangles: Triangles, actors: Actors, bodies: Mapping[str, AgentBody]
    ) -> tuple[dict[str, tuple[Picture, ...]], Ints]:
        """Return each agent's pictures, and the number of pixels (N, A) that it has of each actor.

        Args:
            triangles: the frame, in the world frame.
            actors: the N actors in it.
            bodies: the A agents, by name.
        """
        images = {name: list(own.values()) for name, own in self._rig.render(triangles, actors, bodies).items()}
        pictures = {
            name: tuple(_picture(*each) for each in zip(self._calibrations[name], own, strict=True))
            for name, own in images.items()
        }
        pixels = [
            sum((_count(image, actors.id) for image in own), np.zeros(len(actors), np.int64)) for own in images.values()
        ]
        return pictures, np.stack(pixels, axis=1)

    def close(self) -> None:
        """Release the renderer's resources."""
        self._rig.close()


@cache  # "auto" would warn in every clip where OpenGL is missing
def _renderer_here() -> str:
    """Return the name of the fastest renderer that works here."""
    renderer = make_renderer("auto")
    renderer.close()
    return renderer.name


def nearest_in_blocks(
    depth_m: NDArray[np.float32], label: NDArray[np.uint8]
) -> tuple[NDArray[np.float16], NDArray[np.uint8]]:
    """Return depth and class of the nearest surface in each block of `BLOCK` x `BLOCK` pixels.

    Args:
        depth_m: (H, W) m; 0: nothing.
        label: (H, W) classes.
    """
    seen = np.where(depth_m > 0, depth_m, np.float32(np.inf))
    depths, labels = _blocks(seen, np.inf), _blocks(label, NO_CLASS)
    nearest = depths.argmin(axis=-1)[..., None]
    depth = np.take_along_axis(depths, nearest, axis=-1)[..., 0]
    depth[np.isinf(depth)] = 0.0
    return depth.astype(np.float16), np.take_along_axis(labels, nearest, axis=-1)[..., 0]


def _blocks(pixels: NDArray[Any], outside: float) -> NDArray[Any]:
    """Return pixels (H, W) by block, (ceil(H / BLOCK), ceil(W / BLOCK), BLOCK^2), with a value beyond the edges."""
    height, width = pixels.shape
    padded = np.pad(pixels, ((0, -height % BLOCK), (0, -width % BLOCK)), constant_values=outside)
    rows, columns = padded.shape[0] // BLOCK, padded.shape[1] // BLOCK
    return padded.reshape(rows, BLOCK, columns, BLOCK).swapaxes(1, 2).reshape(rows, columns, BLOCK**2)


def _picture(calibration: CameraCalibration, image: CameraImage) -> Picture:
    assert image.rgb is not None and image.depth is not None and image.semantic is not None
    return Picture(calibration, image.rgb, *nearest_in_blocks(image.depth, image.semantic))


def _count(image: CameraImage, ids: Ints) -> Ints:
    assert image.instance is not None
    return count_instances(image.instance.reshape(-1), ids)
