"""The training of an identity from points (YOLOO's LGPEnc)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.se3 import Floats
from coopsim.learn.clips.clip import Clip
from coopsim.learn.recipe import TrainingRecipe
from coopsim.learn.samples.sample_frames import thin
from coopsim.learn.samples.sightings import Sightings
from coopsim.learn.tasks.identity_task import IdentityTask
from coopsim.learn.tasks.training_task import first_net
from coopsim.learn.weights import load_point_identity, make_point_identity
from coopsim.nn.identity.clip_teachers import ClipTeachers, Crop
from coopsim.nn.identity.object_points import LEAST_POINTS, ObjectPoints, PointBatch, join_points, points_in_boxes
from coopsim.sensors.camera.crops import best_crops


class PointIdentityTask(IdentityTask):
    """The training of a `PointIdentityNet`.

    Args:
        recipe: of the kind "point_identity"; `teacher` is the folder of a CLIP model, or None.
        seed: of the first weights.

    Raises:
        InvalidValueError: the weights to start with are of another network, or the teacher is no CLIP model.
        MissingDependencyError: there is to be a teacher, and `transformers` is not installed.
    """

    def __init__(self, recipe: TrainingRecipe, seed: int) -> None:
        encoder = first_net(recipe, make_point_identity(recipe.network, seed), load_point_identity)
        super().__init__(recipe, encoder, None if recipe.teacher is None else ClipTeachers(recipe.teacher))
        most: Any = encoder.config.points
        self._most = int(most)

    def inputs(
        self, clip: Clip, seen: Sightings, rng: np.random.Generator, *, whole: bool
    ) -> list[ObjectPoints | None]:
        found: list[ObjectPoints | None] = [None] * len(seen)
        for number, member in np.unique(np.column_stack([seen.scene, seen.agent]), axis=0):
            rows = np.flatnonzero((seen.scene == number) & (seen.agent == member))
            cloud = clip.scenes[number].agents[member].points
            for row, points in zip(rows, points_in_boxes(cloud, seen.boxes[rows], self._most), strict=True):
                shown = points if whole else thin(points, rng, self.settings.thinned)
                found[row] = shown if len(shown) >= LEAST_POINTS else None
        return found

    def crops(self, clip: Clip, seen: Sightings) -> list[Crop | None]:
        found: list[Crop | None] = [None] * len(seen)
        for row in range(len(seen)):
            pictures = clip.scenes[seen.scene[row]].agents[seen.agent[row]].pictures
            cameras = {str(number): picture.calibration for number, picture in enumerate(pictures)}
            best = best_crops(cameras, Boxes3D.from_array(seen.boxes[row : row + 1])) if pictures else None
            if best is not None and best.known[0]:
                found[row] = _cut(pictures[int(best.camera[0])].rgb, best.place_px[0])
        return found

    def joined(self, inputs: Sequence[Any]) -> PointBatch:
        return join_points(inputs)


def _cut(rgb: NDArray[np.uint8], place_px: Floats) -> Crop:
    """Return the pixels that a rectangle touches: first column, first row, last column, last row, as real numbers."""
    left, top = np.floor(place_px[:2] + 0.5).astype(int)
    right, bottom = np.ceil(place_px[2:] + 0.5).astype(int)
    return rgb[max(top, 0) : max(bottom, top + 1, 1), max(left, 0) : max(right, left + 1, 1)]
