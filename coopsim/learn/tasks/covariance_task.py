"""The training of covariances through a differentiable Kalman filter (DMSTrack), on recordings."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict
from typing import Any

import numpy as np
from torch import Tensor, nn

from coopsim.config.load import load
from coopsim.errors import InvalidValueError
from coopsim.learn.losses.losses import sum_of
from coopsim.learn.recipe import TrainingRecipe
from coopsim.learn.recorded.filter_losses import window_errors
from coopsim.learn.recorded.held_out_recordings import HeldOutRecordings
from coopsim.learn.recorded.recorded_windows import RecordedWindow, RecordedWindows
from coopsim.learn.recorded.training_recordings import RecordedWorld
from coopsim.learn.tasks.training_task import LOSS, FoundMap, TrainingTask, WeightsFile, first_net
from coopsim.learn.weights import load_covariance, make_covariance
from coopsim.nn.covariance.covariance_net import CovarianceNet


class CovarianceTask(TrainingTask):
    """The training of a `CovarianceNet`.

    Args:
        recipe: of the kind "covariance".
        seed: of the first weights.

    Raises:
        InvalidValueError: an option that has no meaning here is given, or the weights to start with are of another
            network.
    """

    net: CovarianceNet

    def __init__(self, recipe: TrainingRecipe, seed: int) -> None:
        super().__init__()
        if recipe.samples:
            raise InvalidValueError(f"samples must be empty with kind: covariance, got {dict(recipe.samples)}")
        self._world: RecordedWorld = load(RecordedWorld, recipe.world, "world")
        self.net = first_net(recipe, make_covariance(recipe.network, seed), load_covariance)

    def source(self, seed: int) -> RecordedWindows:
        return RecordedWindows(self._world, seed)

    def validation(self) -> Callable[[nn.Module], Mapping[str, float]]:
        return HeldOutRecordings(self._world)

    def cut(self, clip: RecordedWindow, rng: np.random.Generator) -> Sequence[RecordedWindow]:
        return [clip] if len(clip.numbers) else []

    def cut_held_out(self, clip: RecordedWindow, rng: np.random.Generator) -> Sequence[RecordedWindow]:
        return self.cut(clip, rng)

    def find(self, net: nn.Module, batch: Any) -> list[FoundMap]:
        return []

    def files(self, net: nn.Module, name: str) -> list[WeightsFile]:
        return [WeightsFile(name, net, {"kind": "covariance", "config": asdict(self.net.config)})]

    def forward(self, batch: Sequence[RecordedWindow]) -> dict[str, Tensor]:
        parts = window_errors(self.net, batch).losses()
        return {LOSS: sum_of(parts), **parts}
