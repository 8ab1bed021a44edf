"""The training of encoders of identity: from a sighting of an object to a unit vector that tells it from others.

The losses are those of Gu et al., "YOLOO: You Only Learn from Others Once", eq. 5: delta times those of pairs of
sightings and of triplets, which need no teacher, and gamma times those of image and text teachers, if there are any. A
recipe sets both as `loss`.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from coopsim.config.load import load
from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.se3 import Floats
from coopsim.learn.clips.clip import Clip
from coopsim.learn.losses.contrast_losses import FIRST_LOG_SCALE, hardest_triplets, paired_contrast
from coopsim.learn.recipe import TrainingRecipe
from coopsim.learn.samples.sample_frames import thin
from coopsim.learn.samples.sightings import (
    ResizedCrop,
    Sightings,
    SightingSettings,
    changed,
    compare_sightings,
    draw_groups,
    jittered,
    join_sightings,
    sighted_crops,
    sightings_of,
)
from coopsim.learn.tasks.training_task import TrainingTask, WeightsFile, first_net, weights_metadata
from coopsim.metrics.average_precision import separation
from coopsim.nn.identity.clip_teachers import ClipTeachers, Crop
from coopsim.nn.identity.picture_identity_net import PictureIdentityConfig
from coopsim.nn.identity.point_encoder import LEAST_POINTS, ObjectPoints, PointBatch, join_points, points_in_boxes
from coopsim.sensors.camera.projection import best_crops


@dataclass(frozen=True, slots=True, eq=False)
class SightingGroup:
    """A sample: K sightings of some objects of a clip, with inputs of the encoder and, for teachers, crops."""

    clip: str
    seen: Sightings
    inputs: tuple[Any, ...]
    crops: tuple[Crop | None, ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class SightingBatch:
    """A batch of M sightings.

    Attributes:
        inputs: inputs of the encoder.
        seen: the sightings; identities differ between clips.
        identity: (M,) their identities.
        pairs: (P, 2) rows of the same object: of one agent in two scenes, or of two agents in one.
        crops: crop of each sighting, or empty.
    """

    inputs: Any
    seen: Sightings
    identity: Tensor
    pairs: Tensor
    crops: tuple[Crop | None, ...]


class ContrastedNet(nn.Module):
    """An encoder from inputs to unit vectors (M, D), with the parameters that only its training needs.

    `taught` is the length of the teachers' vectors, if there are teachers.
    """

    def __init__(self, encoder: nn.Module, taught: int | None = None) -> None:
        super().__init__()
        self.encoder = encoder
        self.log_scale = nn.Parameter(torch.tensor(FIRST_LOG_SCALE))
        dim: Any = encoder.dim
        self.to_teachers = nn.Linear(dim, taught) if taught is not None and taught != dim else None

    def as_taught(self, vectors: Tensor) -> Tensor:
        """Return unit vectors of the teachers' length from vectors (M, D): themselves if D is that length."""
        return vectors if self.to_teachers is None else nn.functional.normalize(self.to_teachers(vectors), dim=1)


class IdentityTask(TrainingTask[ContrastedNet]):
    """The training of an encoder of identity, with frozen teachers if any; derive for a kind of input."""

    net: ContrastedNet

    def __init__(self, recipe: TrainingRecipe, encoder: nn.Module, teachers: ClipTeachers | None = None) -> None:
        super().__init__()
        self.kind, self.settings = recipe.kind, load(SightingSettings, recipe.samples, "samples")
        self.net = ContrastedNet(encoder, None if teachers is None else teachers.dim)
        self.teachers = teachers

    @abstractmethod
    def inputs(self, clip: Clip, seen: Sightings, rng: np.random.Generator, *, whole: bool) -> Sequence[Any]:
        """Return the encoder's input of each sighting, randomly changed unless `whole`, or None."""

    @abstractmethod
    def joined(self, inputs: Sequence[Any]) -> Any:
        """Return inputs as a batch for the encoder."""

    def crops(self, clip: Clip, seen: Sightings) -> Sequence[Crop | None]:
        """Return the crop of each sighting from its agent's images, for teachers: none, unless overridden."""
        return [None] * len(seen)

    def cut(self, clip: Clip, rng: np.random.Generator) -> list[SightingGroup]:
        seen = jittered(sightings_of(clip, self.settings), rng, self.settings)
        groups = [self._group(clip, seen.take(rows), rng) for rows in draw_groups(seen, rng, self.settings)]
        return [group for group in groups if len(group.seen)]

    def cut_held_out(self, clip: Clip, rng: np.random.Generator) -> list[SightingGroup]:
        seen = jittered(sightings_of(clip, self.settings), rng, self.settings)
        group = self._group(clip, seen, rng, whole=True)
        return [group] if len(group.seen) else []

    def collate(self, samples: Sequence[SightingGroup]) -> SightingBatch:
        numbers: dict[tuple[str, int], int] = {}
        parts = []
        for sample in samples:
            own = [numbers.setdefault((sample.clip, each), len(numbers)) for each in sample.seen.identity.tolist()]
            parts.append(replace(sample.seen, identity=np.array(own, np.int64)))
        seen = join_sightings(parts)
        near = seen.within_agents(self.settings.frames) | seen.across_agents()
        pairs = np.argwhere(np.triu(near & (seen.identity[:, None] == seen.identity)))
        return SightingBatch(
            self.joined([each for sample in samples for each in sample.inputs]),
            seen,
            torch.from_numpy(seen.identity),
            torch.from_numpy(pairs),
            tuple(crop for sample in samples for crop in sample.crops),
        )

    def evaluate(self, net: ContrastedNet, batches: Sequence[SightingBatch]) -> dict[str, float]:
        """Return the separation (AUC) of sightings of one class: of one agent in time, and of two agents at once."""
        found: dict[str, list[Any]] = {"AUC within": [], "AUC across": []}
        for batch in batches:
            with torch.no_grad():
                vectors = net.encoder(batch.inputs).float().cpu().numpy()
            found["AUC within"].append(
                compare_sightings(vectors, batch.seen, batch.seen.within_agents(self.settings.frames))
            )
            found["AUC across"].append(compare_sightings(vectors, batch.seen, batch.seen.across_agents()))
        values = {}
        for name, parts in found.items():
            if parts:
                similarity, same = (
                    np.concatenate([getattr(p, part) for p in parts]) for part in ("similarity", "same")
                )
                values[name] = separation(similarity, same)
        return {name: round(value, 4) for name, value in values.items() if np.isfinite(value)}

    def files(self, net: ContrastedNet, name: str) -> list[WeightsFile]:
        teachers = "none" if self.teachers is None else "CLIP"
        said = {**weights_metadata(self.kind, net.encoder.config), "teachers": teachers}
        return [WeightsFile(name, net.encoder, said)]

    def losses(self, batch: SightingBatch) -> dict[str, Tensor]:
        vectors = self.net.encoder(batch.inputs)
        with torch.autocast(vectors.device.type, enabled=False):  # cosines of 8 bits would not tell much apart
            vectors = vectors.float()
            first, second = batch.pairs.unbind(1)
            parts = {
                "positive": paired_contrast(vectors[first], vectors[second], batch.identity[first], self.net.log_scale),
                "triplet": hardest_triplets(vectors, batch.identity),
            }
            if self.teachers is not None:
                own = self.net.as_taught(vectors)
                targets = self.teachers.vectors(batch.seen.label, batch.seen.boxes, batch.crops)
                for name, (rows, taught) in targets.items():
                    parts[name] = paired_contrast(own[rows], taught, batch.identity[rows], self.net.log_scale)
        return parts

    def _group(self, clip: Clip, seen: Sightings, rng: np.random.Generator, *, whole: bool = False) -> SightingGroup:
        inputs = self.inputs(clip, seen, rng, whole=whole)
        kept = np.array([k for k, each in enumerate(inputs) if each is not None], np.int64)
        shown = seen.take(kept)
        crops = () if self.teachers is None else self.crops(clip, shown)
        return SightingGroup(clip.key, shown, tuple(inputs[k] for k in kept), tuple(crops))


class PointIdentityTask(IdentityTask):
    """The training of an identity from points (YOLOO's LGPEnc); the recipe's teacher is the folder of a CLIP model."""

    def __init__(self, recipe: TrainingRecipe, seed: int) -> None:
        encoder = first_net(recipe, seed)
        super().__init__(recipe, encoder, None if recipe.teacher is None else ClipTeachers(recipe.teacher))
        self._most = int(encoder.config.points)

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


class PictureIdentityTask(IdentityTask):
    """The training of an identity from images (DINO-CoDT's re-identification, with a small network of our own)."""

    def __init__(self, recipe: TrainingRecipe, seed: int) -> None:
        encoder = first_net(recipe, seed)
        super().__init__(recipe, encoder)
        self._config: PictureIdentityConfig = encoder.config

    def inputs(self, clip: Clip, seen: Sightings, rng: np.random.Generator, *, whole: bool) -> list[ResizedCrop | None]:
        found = sighted_crops(clip, seen, self._config.edge_px, self._config.margin, None if whole else rng)
        return found if whole else [None if crop is None else changed(crop, rng) for crop in found]

    def joined(self, inputs: Sequence[ResizedCrop]) -> Tensor:
        return torch.from_numpy(np.stack(inputs)) if inputs else torch.zeros(0, 3, *2 * (self._config.edge_px,))
