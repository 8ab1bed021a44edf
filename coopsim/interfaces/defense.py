"""The seam for defences: how far a receiver trusts each sender, from what the receiver has and is told."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import ClassVar

import numpy as np

from coopsim.config.spec import instantiate, parse_spec
from coopsim.errors import InvalidValueError
from coopsim.geometry.se3 import SE3, Floats
from coopsim.support.registry import Registry
from coopsim.support.user_code import class_at
from coopsim.types import AgentSpec, Detections, FeatureMap, Message, Observation

LEAST_TRUST = 0.5
"""Trust from which a sender or an object is believed: it is then at least as likely honest as not."""


@dataclass(frozen=True, slots=True, eq=False)
class Claim:
    """A message as its receiver understands it.

    Attributes:
        message: the message as it arrived.
        detections: the objects that it claims, where they were at capture, in the receiver's base frame now.
        base_SE3_sender: the sender's pose at capture, as it states it, in the receiver's base frame now.
        age_s: time since capture as stated; negative for a stamp in the future.
        is_new: False for a message that an earlier frame had already, and that the policy still uses.
        features: function that returns the map of features in the message, or None.
    """

    message: Message
    detections: Detections
    base_SE3_sender: SE3
    age_s: float
    is_new: bool = True
    features: Callable[[], FeatureMap | None] = lambda: None

    @property
    def sender(self) -> str:
        """Name of the sender, as it states it."""
        return self.message.sender


Find = Callable[[Collection[str]], Detections]
"""Function from names of senders to what the policy finds with these alone, in the receiver's base frame now."""


@dataclass(eq=False)
class Reception:
    """Input of a defence: one receiver in one frame. Whatever costs something is computed when it is first asked for.

    Attributes:
        spec: the receiver.
        observation: its observation, with its own detections, sweeps, pose and odometry, and the inbox as it came.
        odom_SE3_base: its base frame now in its odometry frame, in which standing objects stand still.
        claims: its messages.
        find: result of the policy with some senders alone. Each new question may cost a pass of a network.
        rng: random stream of the defence at this receiver.
        own_features: function that returns the map that the receiver would send, or None.
        fuses_maps: the policy fuses more than boxes, so that a message can make it lose objects.
        attackers: the senders that lie, for a defence with `needs_truth`; None for all others.
    """

    spec: AgentSpec
    observation: Observation
    odom_SE3_base: SE3
    claims: Sequence[Claim]
    find: Find
    rng: np.random.Generator = field(default_factory=lambda: np.random.default_rng(0))
    own_features: Callable[[], FeatureMap | None] = lambda: None
    fuses_maps: bool = False
    attackers: frozenset[str] | None = None

    @cached_property
    def own(self) -> Detections:
        """The detections that the receiver has without any message, in its base frame now."""
        return self.find(())

    @property
    def senders(self) -> tuple[str, ...]:
        """The names of the senders, sorted."""
        return tuple(sorted({claim.sender for claim in self.claims}))


@dataclass(frozen=True, slots=True, eq=False)
class Trust:
    """Answer of a defence.

    Attributes:
        senders: trust in [0, 1] by sender; a sender that is not named is believed.
        objects: trust in [0, 1] of each object of each claim, in their order; None: as their senders.
    """

    senders: Mapping[str, float]
    objects: Sequence[Floats] | None = None


class Defense(ABC):
    """The judge of one receiver for one episode: one object for each, so it may keep state.

    Attributes:
        needs_lidar: the defence reads the receiver's sweeps.
        needs_truth: the defence is told who lies: an upper bound, and no competitor.
    """

    needs_lidar: ClassVar[bool] = False
    needs_truth: ClassVar[bool] = False

    @abstractmethod
    def judge(self, reception: Reception) -> Trust:
        """Return the trust of the receiver in its senders now. Called in each frame with sensors, messages or not.

        A sender with less than `LEAST_TRUST` is not believed: its messages have no effect. Of others, objects with
        less are left out, where the policy's messages hold objects.
        """


DEFENSES: Registry[type[Defense]] = Registry("defense", home="coopsim.defenses", group="coopsim.defenses")
"""Defence classes. Installed packages add theirs through the entry-point group `coopsim.defenses`."""


DefenseOption = str | Callable[[], Defense] | None
"""Defence by name, also with parameters, such as "robosac(budget=5)", by the place of its class, such as
"mine.py:MyDefense", or a class or function that makes one; None: all senders are believed."""

_ACCEPTED = "name, name(parameter=value, ...), module:Class or file.py:Class"


def make_defense(defense: str | Callable[[], Defense]) -> Defense:
    """Make a defence; each receiver has its own in each episode.

    Raises:
        UnknownNameError: there is no such defence, or no such parameter.
        InvalidValueError: a parameter's value is not accepted, or the place has no class of defences.
    """
    if not isinstance(defense, str):
        made = defense() if callable(defense) else defense
        if not callable(defense) or not isinstance(made, Defense):
            raise InvalidValueError(f"defense must be a name, a spec or a class of defenses, got {defense!r}")
        return made
    name, parameters = parse_spec("defense", defense, _ACCEPTED)
    if ":" not in name:
        return instantiate("defense", name, DEFENSES.get(name), parameters)
    kind = class_at("defense", name, Defense)  # type: ignore[type-abstract]
    return instantiate("defense", name, kind, parameters)
