"""The training of covariances through a differentiable Kalman filter (DMSTrack), on recordings or in simulation."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np
import torch
from torch import Tensor, nn

from coopsim.config.load import load
from coopsim.errors import InvalidValueError
from coopsim.learn.clips.clip import Clip
from coopsim.learn.losses.filter_losses import recording_errors, window_errors
from coopsim.learn.recipe import TrainingRecipe
from coopsim.learn.samples.windows import (
    RecordedFrames,
    RecordedWindow,
    RecordedWindows,
    RecordedWorld,
    detected_window,
    frames_of,
)
from coopsim.learn.tasks.training_task import TrainingTask, first_net, weights_metadata
from coopsim.learn.weights import load_detector, make_network
from coopsim.metrics.evaluator import Evaluator
from coopsim.metrics.score import summarize
from coopsim.metrics.track_log import TrackLog
from coopsim.nn.covariance.covariance_net import CovarianceNet
from coopsim.nn.inference.backend import PROCESSOR, Backend, numbers_on
from coopsim.nn.inference.detectors import CloudDetector
from coopsim.tracking.ab3dmot_tracker import ab3dmot
from coopsim.types import seconds_to_ns
from coopsim.types.estimates import diagonals
from coopsim.types.groups import DetectionGroups


class CovarianceTask(TrainingTask[CovarianceNet]):
    """The training of a `CovarianceNet` on recordings."""

    def __init__(self, recipe: TrainingRecipe, seed: int) -> None:
        super().__init__()
        if recipe.samples:
            raise InvalidValueError(f"samples must be empty with kind: covariance, got {dict(recipe.samples)}")
        self._world: RecordedWorld = load(RecordedWorld, recipe.world, "world")
        self.net = first_net(recipe, seed)
        self.metadata = weights_metadata("covariance", self.net.config)

    def source(self, seed: int) -> RecordedWindows:
        return RecordedWindows(self._world, seed)

    def validation(self) -> Callable[[nn.Module], Mapping[str, float]]:
        return HeldOutRecordings(self._world)

    def cut(self, clip: RecordedWindow, rng: np.random.Generator) -> Sequence[RecordedWindow]:
        return [clip] if len(clip.numbers) else []

    def losses(self, batch: Sequence[RecordedWindow]) -> dict[str, Tensor]:
        return window_errors(self.net, batch).losses()


class HeldOutRecordings:
    """Validation of covariances: the whole of the recordings that a training holds out, read once."""

    def __init__(self, world: RecordedWorld) -> None:
        folder = world.folder()
        self._recordings = [frames_of(folder.load(name, world.detections), world.dt_s) for name in world.held_out]

    def __call__(self, net: nn.Module) -> dict[str, float]:
        """Return values by name: both losses, the mean squared Mahalanobis distance, and AMOTA by both protocols."""
        assert isinstance(net, CovarianceNet)
        if not self._recordings:
            return {}
        with torch.no_grad():
            values = recording_errors(net, self._recordings).summary()
        counted = summarize([_log_of(net, each) for each in self._recordings])
        scores = {"AMOTA": counted["AMOTA"], "AMOTA ignored": counted.ignoring_false_positives()["AMOTA"]}
        return {name: round(float(value), 4) for name, value in {**values, **scores}.items()}


def _log_of(net: CovarianceNet, recorded: RecordedFrames) -> TrackLog:
    """Return the log of AB3DMOT on a recording, the agents in turn, with the covariances of a network."""
    tracker, evaluator, variance, row = ab3dmot(motion=net.motion()), Evaluator(), net.variances(recorded.numbers), 0
    for frame, groups in enumerate(recorded.found):
        found = replace(groups.joined, covariance=diagonals(variance[row : row + len(groups.joined)]))
        row += len(found)
        tracks = tracker.step_in_turn(DetectionGroups(found, groups.starts), seconds_to_ns(frame * recorded.dt_s))
        evaluator.update(recorded.truth[frame], tracks)
    return evaluator.log


class SeenCovarianceTask(TrainingTask[CovarianceNet]):
    """The training of a `CovarianceNet` that also reads the detecting agent's features, on simulated clips."""

    def __init__(self, recipe: TrainingRecipe, seed: int) -> None:
        super().__init__()
        for name, given in (("samples", recipe.samples), ("start", recipe.start)):
            if given:
                raise InvalidValueError(f"{name} must be left out with kind: seen_covariance, got {given}")
        detector = load_detector(recipe.detector)
        self.net = make_network("covariance", {"features": detector.config.features, **recipe.network}, seed)
        if self.net.config.features not in (0, detector.config.features):
            raise InvalidValueError(f"network features must be the detector's {detector.config.features}, or 0")
        backend = Backend(numbers=numbers_on(PROCESSOR.device, recipe.precision))
        self._detector, self._most = CloudDetector(detector, backend), 2 * recipe.block
        self._kept: OrderedDict[str, RecordedWindow] = OrderedDict()
        self.metadata = weights_metadata("covariance", self.net.config, recipe, detector)

    def cut(self, clip: Clip, rng: np.random.Generator) -> Sequence[RecordedWindow]:
        window = self.window(clip)
        return [window] if len(window.numbers) else []

    def window(self, clip: Clip) -> RecordedWindow:
        """Return the window of a clip; those of a block's clips are kept, as each is asked for in every pass."""
        if clip.key not in self._kept:
            window = detected_window(clip, self._detector)
            self._kept[clip.key] = window if self.net.config.features else replace(window, patches=None)
            while len(self._kept) > self._most:
                self._kept.popitem(last=False)
        return self._kept[clip.key]

    def evaluate(self, net: CovarianceNet, batches: Sequence[Sequence[RecordedWindow]]) -> dict[str, float]:
        """Return values by name: both losses, and the mean squared Mahalanobis distance of innovations."""
        windows = [window for batch in batches for window in batch]
        if not windows:
            return {}
        with torch.no_grad():
            return window_errors(net, windows).summary()

    def losses(self, batch: Sequence[RecordedWindow]) -> dict[str, Tensor]:
        return window_errors(self.net, batch).losses()
