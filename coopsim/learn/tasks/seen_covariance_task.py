"""The training of covariances that also look at the detecting agent's features, in simulation (DMSTrack)."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Sequence
from dataclasses import asdict, replace
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn

from coopsim.errors import InvalidValueError
from coopsim.learn.clips.clip import Clip
from coopsim.learn.losses.losses import sum_of
from coopsim.learn.recipe import TrainingRecipe
from coopsim.learn.recorded.detected_windows import detected_window
from coopsim.learn.recorded.filter_losses import window_errors
from coopsim.learn.recorded.recorded_windows import RecordedWindow
from coopsim.learn.tasks.training_task import LOSS, FoundMap, TrainingTask, WeightsFile
from coopsim.learn.weights import encoder_digest, load_detector, make_covariance
from coopsim.nn.covariance.covariance_net import CovarianceNet
from coopsim.nn.inference.backend import PROCESSOR, Backend
from coopsim.nn.inference.cloud_detector import CloudDetector
from coopsim.nn.inference.devices import numbers_on


class SeenCovarianceTask(TrainingTask):
    """The training of a `CovarianceNet` on what a network detects in simulated clips.

    Args:
        recipe: of the kind "seen_covariance".
        seed: of the first weights.

    Raises:
        InvalidValueError: an option that has no meaning here is given.
    """

    net: CovarianceNet

    def __init__(self, recipe: TrainingRecipe, seed: int) -> None:
        super().__init__()
        for name, given in (("samples", recipe.samples), ("start", recipe.start)):
            if given:
                raise InvalidValueError(f"{name} must be left out with kind: seen_covariance, got {given}")
        detector = load_detector(recipe.detector)
        self.net = make_covariance({"features": detector.config.features, **recipe.network}, seed)
        if self.net.config.features not in (0, detector.config.features):
            raise InvalidValueError(f"network features must be the detector's {detector.config.features}, or 0")
        backend = Backend(numbers=numbers_on(PROCESSOR.device, recipe.precision))
        self._detector, self._most = CloudDetector(detector, backend), 2 * recipe.block
        self._kept: OrderedDict[str, RecordedWindow] = OrderedDict()
        self._metadata = {
            "kind": "covariance",
            "config": asdict(self.net.config),
            "detector": recipe.detector,
            "encoder_digest": encoder_digest(detector),
        }

    def cut(self, clip: Clip, rng: np.random.Generator) -> Sequence[RecordedWindow]:
        window = self.window(clip)
        return [window] if len(window.numbers) else []

    def cut_held_out(self, clip: Clip, rng: np.random.Generator) -> Sequence[RecordedWindow]:
        return self.cut(clip, rng)

    def window(self, clip: Clip) -> RecordedWindow:
        """Return the window of a clip; those of a block's clips are kept, as each is asked for in every pass."""
        if clip.key not in self._kept:
            self._kept[clip.key] = self._without_features(detected_window(clip, self._detector))
            while len(self._kept) > self._most:
                self._kept.popitem(last=False)
        return self._kept[clip.key]

    def _without_features(self, window: RecordedWindow) -> RecordedWindow:
        if self.net.config.features:
            return window
        return replace(window, patches=None)

    def find(self, net: nn.Module, batch: Any) -> list[FoundMap]:
        return []

    def look(self, net: nn.Module, batches: Sequence[Sequence[RecordedWindow]]) -> dict[str, float]:
        """Return values by name: both losses, and the mean squared Mahalanobis distance of innovations."""
        assert isinstance(net, CovarianceNet)
        windows = [window for batch in batches for window in batch]
        if not windows:
            return {}
        with torch.no_grad():
            return window_errors(net, windows).summary()

    def files(self, net: nn.Module, name: str) -> list[WeightsFile]:
        return [WeightsFile(name, net, self._metadata)]

    def forward(self, batch: Sequence[RecordedWindow]) -> dict[str, Tensor]:
        parts = window_errors(self.net, batch).losses()
        return {LOSS: sum_of(parts), **parts}
