"""The training of encoders of identity: from a sighting of an object to a unit vector that tells it from others.

The losses are those of Gu et al., "YOLOO: You Only Learn from Others Once", eq. 5: delta times those of pairs of
sightings and of triplets, which need no teacher, and gamma times those of image and text teachers, if there are any. A
recipe sets both as `loss`.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any, Protocol

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from coopsim.config.load import load
from coopsim.geometry.se3 import Floats
from coopsim.learn.clips.clip import Clip
from coopsim.learn.losses.contrast_losses import FIRST_LOG_SCALE, hardest_triplets, paired_contrast
from coopsim.learn.losses.losses import sum_of
from coopsim.learn.recipe import TrainingRecipe
from coopsim.learn.samples.compared_sightings import compare_sightings
from coopsim.learn.samples.sightings import (
    Sightings,
    SightingSettings,
    draw_groups,
    jittered,
    join_sightings,
    sightings_of,
)
from coopsim.learn.tasks.training_task import LOSS, FoundMap, TrainingTask, WeightsFile
from coopsim.metrics.average_precision import separation
from coopsim.types import Ints

Crop = NDArray[np.uint8]
"""A part of a picture (h, w, 3)."""


class Teachers(Protocol):
    """What vectors are also to be near to: those that a frozen network makes of pictures and words."""

    dim: int

    def vectors(self, label: Ints, boxes: Floats, crops: Sequence[Crop | None]) -> Mapping[str, tuple[Tensor, Tensor]]:
        """Return by teacher's name the rows (K,) of sightings that it has vectors of, and these: (K, dim), of length 1.

        Args:
            label: (M,) classes of the sightings.
            boxes: (M, 7) x, y, z, l, w, h, yaw in the agents' base frames.
            crops: of each, its agent's picture of it; None: it is in none, or nobody asked for crops.
        """


@dataclass(frozen=True, slots=True, eq=False)
class SeenGroup:
    """A sample: sightings of some objects of a clip.

    Attributes:
        clip: key of the clip.
        seen: K sightings, with boxes as they were given to the encoder.
        inputs: of each, what the encoder makes a vector of.
        crops: of each, for teachers; empty without.
    """

    clip: str
    seen: Sightings
    inputs: tuple[Any, ...]
    crops: tuple[Crop | None, ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class SeenBatch:
    """Samples together: M sightings.

    Attributes:
        inputs: of the encoder.
        seen: the sightings; identities differ between clips.
        identity: (M,) the same, as a tensor.
        pairs: (P, 2) rows of the same object: of one agent in two scenes, or of two agents in one.
        crops: of each sighting, or empty.
    """

    inputs: Any
    seen: Sightings
    identity: Tensor
    pairs: Tensor
    crops: tuple[Crop | None, ...]


class ContrastedNet(nn.Module):
    """An encoder and what its training learns beside it.

    Args:
        encoder: from inputs to unit vectors (M, D); has `config`, a dataclass, and `dim`, which is D.
        taught: length of the teachers' vectors; None: there are none.
    """

    def __init__(self, encoder: nn.Module, taught: int | None = None) -> None:
        super().__init__()
        self.encoder = encoder
        self.log_scale = nn.Parameter(torch.tensor(FIRST_LOG_SCALE))
        dim: Any = encoder.dim
        self.to_teachers = nn.Linear(dim, taught) if taught is not None and taught != dim else None

    def as_taught(self, vectors: Tensor) -> Tensor:
        """Return vectors (M, D) as teachers' ones, of length 1: themselves if those are of the same length D."""
        return vectors if self.to_teachers is None else nn.functional.normalize(self.to_teachers(vectors), dim=1)


class IdentityTask(TrainingTask):
    """The training of an encoder of identity; derive for a kind of input.

    Args:
        recipe: of a kind "..._identity"; `samples` are `SightingSettings`.
        encoder: with its first weights, see `ContrastedNet`.
        teachers: frozen.
    """

    net: ContrastedNet

    def __init__(self, recipe: TrainingRecipe, encoder: nn.Module, teachers: Teachers | None = None) -> None:
        super().__init__()
        self.kind, self.settings = recipe.kind, load(SightingSettings, recipe.samples, "samples")
        self.net = ContrastedNet(encoder, None if teachers is None else teachers.dim)
        self.teachers = teachers

    @abstractmethod
    def inputs(self, clip: Clip, seen: Sightings, rng: np.random.Generator, *, whole: bool) -> Sequence[Any]:
        """Return of each sighting what the encoder makes a vector of; None: there is too little.

        Args:
            clip: the scenes.
            seen: the sightings, with the errors of a detector.
            rng: changes what is seen.
            whole: change nothing, for a look at held-out places.
        """

    @abstractmethod
    def joined(self, inputs: Sequence[Any]) -> Any:
        """Return inputs as a batch for the encoder."""

    def crops(self, clip: Clip, seen: Sightings) -> Sequence[Crop | None]:
        """Return of each sighting its agent's picture of it, for teachers: none, unless overridden."""
        return [None] * len(seen)

    def cut(self, clip: Clip, rng: np.random.Generator) -> list[SeenGroup]:
        seen = jittered(sightings_of(clip, self.settings), rng, self.settings)
        groups = [self._group(clip, seen.take(rows), rng) for rows in draw_groups(seen, rng, self.settings)]
        return [group for group in groups if len(group.seen)]

    def cut_held_out(self, clip: Clip, rng: np.random.Generator) -> list[SeenGroup]:
        seen = jittered(sightings_of(clip, self.settings), rng, self.settings)
        group = self._group(clip, seen, rng, whole=True)
        return [group] if len(group.seen) else []

    def collate(self, samples: Sequence[SeenGroup]) -> SeenBatch:
        numbers: dict[tuple[str, int], int] = {}
        parts = []
        for sample in samples:
            own = [numbers.setdefault((sample.clip, each), len(numbers)) for each in sample.seen.identity.tolist()]
            parts.append(replace(sample.seen, identity=np.array(own, np.int64)))
        seen = join_sightings(parts)
        near = seen.within_agents(self.settings.frames) | seen.across_agents()
        pairs = np.argwhere(np.triu(near & (seen.identity[:, None] == seen.identity)))
        return SeenBatch(
            self.joined([each for sample in samples for each in sample.inputs]),
            seen,
            torch.from_numpy(seen.identity),
            torch.from_numpy(pairs),
            tuple(crop for sample in samples for crop in sample.crops),
        )

    def find(self, net: nn.Module, batch: SeenBatch) -> list[FoundMap]:
        return []

    def look(self, net: nn.Module, batches: Sequence[SeenBatch]) -> dict[str, float]:
        """Return how well sightings of one class are told apart: of one agent in time, and of two agents at once."""
        assert isinstance(net, ContrastedNet)
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

    def files(self, net: nn.Module, name: str) -> list[WeightsFile]:
        assert isinstance(net, ContrastedNet)
        config: Any = net.encoder.config
        said = {"kind": self.kind, "config": asdict(config), "teachers": "none" if self.teachers is None else "CLIP"}
        return [WeightsFile(name, net.encoder, said)]

    def forward(self, batch: SeenBatch) -> dict[str, Tensor]:
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
                for name, (rows, taught) in self._taught(batch).items():
                    parts[name] = paired_contrast(own[rows], taught, batch.identity[rows], self.net.log_scale)
        return {LOSS: sum_of(parts), **parts}

    def _taught(self, batch: SeenBatch) -> Mapping[str, tuple[Tensor, Tensor]]:
        """Return the teachers' vectors, see `Teachers`."""
        assert self.teachers is not None
        return self.teachers.vectors(batch.seen.label, batch.seen.boxes, batch.crops)

    def _group(self, clip: Clip, seen: Sightings, rng: np.random.Generator, *, whole: bool = False) -> SeenGroup:
        inputs = self.inputs(clip, seen, rng, whole=whole)
        kept = np.array([k for k, each in enumerate(inputs) if each is not None], np.int64)
        shown = seen.take(kept)
        crops = () if self.teachers is None else self.crops(clip, shown)
        return SeenGroup(clip.key, shown, tuple(inputs[k] for k in kept), tuple(crops))
