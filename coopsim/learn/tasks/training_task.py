"""What a training trains: a network, how its samples are drawn, and the losses on a batch of them."""

from __future__ import annotations

import copy
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any, TypeVar

import numpy as np
from torch import Tensor, nn

from coopsim.errors import InvalidValueError
from coopsim.learn.losses.targets import Targets
from coopsim.learn.recipe import TrainingRecipe
from coopsim.learn.samples.sample_order import SampleSource
from coopsim.types import BevGrid, Detections

N = TypeVar("N", bound=nn.Module)

LOSS = "loss"
"""Name of the total among the losses: what is made smaller."""


@dataclass(frozen=True, slots=True, eq=False)
class FoundMap:
    """What a network found in a map, and what is there.

    Attributes:
        detections: in the frame of `grid`.
        targets: of this map alone.
        grid: the cells of the targets.
    """

    detections: Detections
    targets: Targets
    grid: BevGrid


@dataclass(frozen=True, slots=True, eq=False)
class WeightsFile:
    """A file of weights that a training gives.

    Attributes:
        name: of the file, without its ending.
        net: whose weights are in it.
        metadata: what the file says of them: see `coopsim.learn.weights.save_weights`.
    """

    name: str
    net: nn.Module
    metadata: Mapping[str, Any]


class TrainingTask(nn.Module, ABC):
    """A network in training; calling it with a batch gives the losses.

    Attributes:
        net: the network whose parameters are trained, and which is stored.
        progress: share of the training that has passed, in [0, 1]; set before each step.
    """

    net: nn.Module
    progress: float = 1.0

    def source(self, seed: int) -> SampleSource | None:
        """Return what it is trained on instead of simulated clips; None: these, in the recipe's world.

        Args:
            seed: of the draws.
        """
        return None

    def validation(self) -> Callable[[nn.Module], Mapping[str, float]] | None:
        """Return a look of its own at what is held out; None: that at held-out places."""
        return None

    @abstractmethod
    def cut(self, clip: Any, rng: np.random.Generator) -> Sequence[Any]:
        """Draw samples from a clip; none is accepted."""

    @abstractmethod
    def cut_held_out(self, clip: Any, rng: np.random.Generator) -> Sequence[Any]:
        """Draw samples that show more, and without what is there only to make training harder, for a look at AP."""

    @abstractmethod
    def find(self, net: nn.Module, batch: Any) -> list[FoundMap]:
        """Return what a network finds in the maps of a batch."""

    def look(self, net: nn.Module, batches: Sequence[Any]) -> Mapping[str, float] | None:
        """Return values of its own, by name, of held-out batches; None: average precisions of what `find` finds."""
        return None

    def collate(self, samples: Sequence[Any]) -> Any:
        """Return samples as a batch: their list, unless overridden."""
        return list(samples)

    @abstractmethod
    def files(self, net: nn.Module, name: str) -> list[WeightsFile]:
        """Return the files that a trained network is stored in; the first one is of the recipe's name."""

    @abstractmethod
    def forward(self, batch: Any) -> dict[str, Tensor]:
        """Return losses by name, each a scalar; `LOSS` is their total."""


def first_net(recipe: TrainingRecipe, net: N, load: Callable[[str], N]) -> N:
    """Return the network that a training begins with: `net`, or a copy of that of the recipe's `start`, by `load`.

    Raises:
        InvalidValueError: the recipe names options of a network, and these are not those of `start`.
    """
    if recipe.start is None:
        return net
    start: Any = load(recipe.start)
    made: Any = net
    if recipe.network and start.config != made.config:
        raise InvalidValueError(f"network must be that of start, {asdict(start.config)}, or left out")
    copied: N = copy.deepcopy(start).requires_grad_(True)
    return copied


def mean_losses(losses: Sequence[dict[str, Tensor]]) -> dict[str, Tensor]:
    """Return the means of losses by name; a name that some lack counts as zero there."""
    names = dict.fromkeys(name for each in losses for name in each)
    found = {name: [each[name] for each in losses if name in each] for name in names}
    return {name: sum(values[1:], values[0]) / len(losses) for name, values in found.items()}
