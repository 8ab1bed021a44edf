"""Parts of the loss of a map that users add: a recipe names their class and weight, as `{"mine.py:Edges": 0.5}`."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping

from torch import Tensor

from coopsim.errors import InvalidValueError
from coopsim.learn.samples.targets import Targets
from coopsim.nn.detector.detector_net import CentreHead, JudgedHead
from coopsim.support.user_code import class_at, names_code


class MapLoss(ABC):
    """A part of the loss of a map. Without arguments a class makes it, and a training calls it at every step."""

    @abstractmethod
    def __call__(self, head: CentreHead | JudgedHead, features: Tensor, targets: Targets) -> Tensor:
        """Return the loss, a scalar with gradients.

        Args:
            head: the network's head: `head.heat(features)` gives features and logits of heat (B, 9, h, w), `head.codes`
                the codes of boxes at cells.
            features: (B, C, h, w) maps that the head reads, of single agents or fused.
            targets: targets of the maps.
        """


OwnLosses = Mapping[str, MapLoss]
"""Losses of users by their names in the recipe."""


def own_losses(names: Iterable[str]) -> dict[str, MapLoss]:
    """Return the losses among names of parts that are places, `file.py:Class` or `module:Class`.

    Raises:
        CoopsimError: a place has no class of losses, or one that needs arguments.
    """
    return {name: _made(name) for name in names if names_code(name)}


def losses_of(own: OwnLosses, head: CentreHead | JudgedHead, features: Tensor, targets: Targets) -> dict[str, Tensor]:
    """Return the values of users' losses of maps by name; arguments as of `MapLoss`.

    Raises:
        InvalidValueError: a loss is no scalar.
    """
    values = {name: loss(head, features, targets) for name, loss in own.items()}
    for name, value in values.items():
        if not (isinstance(value, Tensor) and value.shape == ()):
            given = f"a tensor of shape {tuple(value.shape)}" if isinstance(value, Tensor) else repr(value)
            raise InvalidValueError(f"loss {name!r} must return a tensor of one number, got {given}")
    return values


def _made(name: str) -> MapLoss:
    made = class_at("loss", name, MapLoss)  # type: ignore[type-abstract]
    try:
        return made()
    except TypeError as error:
        raise InvalidValueError(f"loss {name!r} cannot be made without arguments: {error}") from error
