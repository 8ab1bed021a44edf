"""The training of an identity from pictures (DINO-CoDT's re-identification, with a small network of our own)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch
from torch import Tensor

from coopsim.learn.clips.clip import Clip
from coopsim.learn.recipe import TrainingRecipe
from coopsim.learn.samples.sighted_crops import ResizedCrop, changed, sighted_crops
from coopsim.learn.samples.sightings import Sightings
from coopsim.learn.tasks.identity_task import IdentityTask
from coopsim.learn.tasks.training_task import first_net
from coopsim.learn.weights import load_picture_identity, make_picture_identity
from coopsim.nn.identity.picture_identity_net import PictureIdentityConfig


class PictureIdentityTask(IdentityTask):
    """The training of a `PictureIdentityNet`.

    Args:
        recipe: of the kind "picture_identity".
        seed: of the first weights.

    Raises:
        InvalidValueError: the weights to start with are of another network.
    """

    def __init__(self, recipe: TrainingRecipe, seed: int) -> None:
        encoder = first_net(recipe, make_picture_identity(recipe.network, seed), load_picture_identity)
        super().__init__(recipe, encoder)
        self._config: PictureIdentityConfig = encoder.config

    def inputs(self, clip: Clip, seen: Sightings, rng: np.random.Generator, *, whole: bool) -> list[ResizedCrop | None]:
        found = sighted_crops(clip, seen, self._config.edge_px, self._config.margin, None if whole else rng)
        return found if whole else [None if crop is None else changed(crop, rng) for crop in found]

    def joined(self, inputs: Sequence[ResizedCrop]) -> Tensor:
        return torch.from_numpy(np.stack(inputs)) if inputs else torch.zeros(0, 3, *2 * (self._config.edge_px,))
