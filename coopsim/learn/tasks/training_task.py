"""Task of a training: a network, the drawing of its samples, and the losses on a batch of them."""

from __future__ import annotations

import copy
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Generic, Self, TypeVar

import numpy as np
from torch import Tensor, nn

from coopsim.errors import InvalidValueError
from coopsim.learn.clips.clip import ClipSource
from coopsim.learn.losses.head_losses import sum_of
from coopsim.learn.recipe import TrainingRecipe
from coopsim.learn.samples.targets import Targets
from coopsim.learn.weights import encoder_digest, load_network, make_network
from coopsim.nn.detector.detector_net import DetectorNet
from coopsim.types import BevGrid, Detections

LOSS = "loss"
"""Name of the total among the losses: what is made smaller."""


@dataclass(frozen=True, slots=True, eq=False)
class FoundMap:
    """Detections of a network in a map, in the frame of `grid`, and the map's targets."""

    detections: Detections
    targets: Targets
    grid: BevGrid


@dataclass(frozen=True, slots=True, eq=False)
class WeightsFile:
    """A file of weights that a training gives: name without ending, network, and metadata, see `save_weights`."""

    name: str
    net: nn.Module
    metadata: Mapping[str, Any]


N = TypeVar("N", bound=nn.Module)


class TrainingTask(nn.Module, ABC, Generic[N]):
    """A network in training; calling it with a batch gives the losses.

    Attributes:
        net: the network whose parameters are trained, and which is stored.
        metadata: metadata of its file of weights, see `weights_metadata`.
        frozen: modules that stay in evaluation mode: their statistics of normalisation are not to change.
        progress: share of the training that has passed, in [0, 1]; set before each step.
        cuts_apart: samples are drawn without any network, so that other processes may do it.

    Raises:
        InvalidValueError: an option has no meaning for the task, or the networks of a recipe do not fit together.
    """

    net: N
    metadata: Mapping[str, Any]
    frozen: Sequence[nn.Module] = ()
    progress: float = 1.0
    cuts_apart: bool = False

    def train(self, mode: bool = True) -> Self:
        super().train(mode)
        for module in self.frozen:
            module.eval()
        return self

    def source(self, seed: int) -> ClipSource | None:
        """Return the task's own source of clips; None: simulated clips, in the recipe's world."""
        return None

    def validation(self) -> Callable[[nn.Module], Mapping[str, float]] | None:
        """Return the task's own validation; None: that of held-out clips."""
        return None

    @abstractmethod
    def cut(self, clip: Any, rng: np.random.Generator) -> Sequence[Any]:
        """Draw samples from a clip; none is accepted."""

    def cut_held_out(self, clip: Any, rng: np.random.Generator) -> Sequence[Any]:
        """Draw samples for validation, without what only makes training harder: those of `cut`, unless overridden."""
        return self.cut(clip, rng)

    def find(self, net: N, batch: Any) -> list[FoundMap]:
        """Return what a network finds in the maps of a batch."""
        return []

    def evaluate(self, net: N, batches: Sequence[Any]) -> Mapping[str, float] | None:
        """Return values of held-out batches by name; None: average precisions of what `find` finds."""
        return None

    def collate(self, samples: Sequence[Any]) -> Any:
        """Return samples as a batch: their list, unless overridden."""
        return list(samples)

    def files(self, net: N, name: str) -> list[WeightsFile]:
        """Return the files that a trained network is stored in; the first one has the recipe's name."""
        return [WeightsFile(name, net, self.metadata)]

    def forward(self, batch: Any) -> dict[str, Tensor]:
        """Return losses by name, each a scalar; `LOSS` is their total."""
        parts = self.losses(batch)
        return parts if LOSS in parts else {LOSS: sum_of(parts), **parts}

    @abstractmethod
    def losses(self, batch: Any) -> dict[str, Tensor]:
        """Return the parts of the loss by name; with `LOSS`, first, where the total is not their weighted sum."""


AnyTask = TrainingTask[Any]


def weights_metadata(
    kind: str, config: Any, recipe: TrainingRecipe | None = None, detector: DetectorNet | None = None
) -> dict[str, Any]:
    """Return the metadata of a file of weights: kind, options, and the detector that the network stands on, if any."""
    said: dict[str, Any] = {"kind": kind, "config": asdict(config)}
    if recipe is not None and detector is not None:
        said |= {"detector": Path(recipe.detector).stem, "encoder_digest": encoder_digest(detector)}
    return said


def first_net(recipe: TrainingRecipe, seed: int) -> Any:
    """Return the first network of a training: with random weights, or a copy of that of the recipe's `start`."""
    net = make_network(recipe.kind, recipe.network, seed)
    if recipe.start is None:
        return net
    start = load_network(recipe.kind, recipe.start)
    if recipe.network:
        require_config_of(start, net.config, hint=", or left out")
    return copy.deepcopy(start).requires_grad_(True)


def require_config_of(start: Any, config: Any, name: str = "network", hint: str = "") -> None:
    """Raise `InvalidValueError` unless options are those of the network that a training begins with."""
    if start.config != config:
        raise InvalidValueError(f"{name} must be that of start, {asdict(start.config)}{hint}")


def copy_weights(source: nn.Module, net: nn.Module) -> None:
    """Copy weights into a network of the same sizes; a second look that only one of the two has is left out."""
    others = [name for names in net.load_state_dict(source.state_dict(), strict=False) for name in names]
    if wrong := [name for name in others if "judge." not in name]:
        raise InvalidValueError(f"network must have the sizes of start, which differs in {', '.join(wrong)}")


def mean_losses(losses: Sequence[dict[str, Tensor]]) -> dict[str, Tensor]:
    """Return the means of losses by name; a name that some lack counts as zero there."""
    names = dict.fromkeys(name for each in losses for name in each)
    found = {name: [each[name] for each in losses if name in each] for name in names}
    return {name: sum(values[1:], values[0]) / len(losses) for name, values in found.items()}
