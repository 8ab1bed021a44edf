"""The reward `message_gain`: what receivers gain by hearing an agent, less the price of its bytes.

It is a paired counterfactual: in each step a receiving policy tracks for all agents, once with their whole inboxes and
once without the messages in question, from the same observations and on the same truth. Each of the two has its own
state, so what was never heard stays unheard.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np

from coopsim.agents.policy import Policy
from coopsim.catalog import REWARDS, PolicySpec
from coopsim.envs.frames import Frame
from coopsim.envs.simulated.planned_driving import PlannedDriving
from coopsim.episode import policy_seed
from coopsim.errors import InvalidValueError
from coopsim.metrics.log_pool import LogPool
from coopsim.metrics.scorer import Scorer
from coopsim.support.checks import require_choice, require_non_negative
from coopsim.types import AgentSpec, Observation
from coopsim.types.driving import LARGEST_BRAKING_M_S2, acceleration_of

_RATE_BIT_S = 6e6
"""Default data rate of ITS-G5 (ETSI EN 302 663: 10 MHz, QPSK, code rate 1/2), of which load is a share."""


@REWARDS.register("message_gain")
@dataclass(frozen=True, kw_only=True)
class MessageGain:
    """Gain of the receivers by hearing, less costs of bytes and of channel load.

    reward = gain - `byte_price` * kilobytes sent in the step - `load_price` * channel load

    With `share="own"` the gain is the mean over the other agents of their metric less the same without this agent's
    messages; with "team" it is the mean over all agents, less the same without any message, and the price is that of
    the mean sender. The gain is that of the frame that the step leads to. Channel load is the share of a step for which
    all its messages together occupy a channel of 6 Mbit/s, and everybody pays it.

    Attributes:
        receiver: name or spec of the receiving policy, as "coop_fuse".
        metric: "mota": the frame's MOTA, unbounded below; "hota": the step's change of the episode's HOTA so far, so
            that an episode's rewards add up to its gain; "braking": the deceleration that the planner avoids by
            hearing, over 8 m/s², of cars that a planner or accelerations drive.
        planner: name or spec of the planner for "braking".
        share: "own" or "team".
        byte_price: price of a kilobyte.
        load_price: price of a full channel.

    Raises:
        UnknownNameError, InvalidValueError: a value is not accepted.
    """

    receiver: str = "late_fusion"
    metric: Literal["mota", "hota", "braking"] = "mota"
    planner: str = "idm_aeb"
    share: Literal["own", "team"] = "own"
    byte_price: float = 0.0
    load_price: float = 0.0

    def __post_init__(self) -> None:
        require_choice("metric", self.metric, ("mota", "hota", "braking"))
        require_choice("share", self.share, ("own", "team"))
        require_non_negative(byte_price=self.byte_price, load_price=self.load_price)
        if self.make_receiver().needs.truth:
            raise InvalidValueError(f"receiver must be a policy that is not told the truth, got {self.receiver!r}")

    def make_receiver(self) -> Policy:
        """Return a new receiving policy."""
        return PolicySpec.parse(self.receiver).make()


class MessageGains:
    """Receivers of an episode: one that hears all, and one for each choice of unheard messages.

    Args:
        reward: the reward.
        specs: specs of the agents.
        match_iou: 3D IoU from which a track is on an object.
        region_m: (2,) half the length and width of the evaluation region; None: unlimited.
        seed: seed of the episode.
    """

    def __init__(
        self,
        reward: MessageGain,
        specs: Mapping[str, AgentSpec],
        match_iou: float,
        region_m: tuple[float, float] | None,
        seed: int,
    ) -> None:
        self._reward, self._dt_s = reward, next(iter(specs.values())).dt_s
        self._whole = _Receivers(reward, specs, Scorer(tuple(specs), match_iou, region_m), seed)
        unheard = [frozenset([name]) for name in specs] if reward.share == "own" else [frozenset(specs)]
        self._without = {
            senders: _Receivers(reward, specs, Scorer(tuple(specs), match_iou, region_m), seed) for senders in unheard
        }

    def step(
        self, frame: Frame, received: Mapping[str, Observation], sent_bytes: Mapping[str, int]
    ) -> dict[str, float]:
        """Return the rewards of the step that leads to a frame, by agent; called for the first frame, too.

        Args:
            frame: the frame.
            received: its observations with inboxes.
            sent_bytes: bytes that each agent broadcast in the step.
        """
        heard = self._whole.step(frame, received)
        gains = {
            senders: _gain(heard, receivers.step(frame, _unheard(received, senders)), senders)
            for senders, receivers in self._without.items()
        }
        kilobytes = {name: size / 1000 for name, size in sent_bytes.items()}
        total = sum(kilobytes.values())
        load = 8000 * total / (_RATE_BIT_S * self._dt_s)
        rewards = {}
        for name in frame.agents:
            own = self._reward.share == "own"
            gain = gains[frozenset([name])] if own else next(iter(gains.values()))
            paid = kilobytes.get(name, 0.0) if own else total / max(1, len(frame.agents))
            rewards[name] = gain - self._reward.byte_price * paid - self._reward.load_price * load
        return rewards


class _Receivers:
    """A receiving policy of all agents, with the metric of each."""

    def __init__(self, reward: MessageGain, specs: Mapping[str, AgentSpec], scorer: Scorer, seed: int) -> None:
        self._metric, self._policy, self._scorer = reward.metric, reward.make_receiver(), scorer
        self._policy.reset(specs, seed=policy_seed(seed))
        self._driving = PlannedDriving(reward.planner, specs) if reward.metric == "braking" else None
        self._hota: dict[str, float] = {}

    def step(self, frame: Frame, received: Mapping[str, Observation]) -> dict[str, float]:
        """Return each agent's metric; larger is better."""
        tracks = self._policy.track_all(received)
        if self._driving is not None:
            asked = self._driving.commands(frame, tracks)
            return {name: min(acceleration_of(command), 0.0) / LARGEST_BRAKING_M_S2 for name, command in asked.items()}
        counts = self._scorer.update(frame.agents, tracks)
        if self._metric == "mota":
            return {name: 1 - (each.fp + each.fn + each.idsw) / max(each.gt, 1) for name, each in counts.items()}
        before, self._hota = (
            self._hota,
            {name: LogPool.of([self._scorer.evaluators[name].log]).hota.hota for name in counts},
        )
        return {name: value - before.get(name, 0.0) for name, value in self._hota.items()}


def _unheard(received: Mapping[str, Observation], senders: frozenset[str]) -> dict[str, Observation]:
    """Return the observations without the messages of some senders."""
    return {
        name: each.with_inbox(tuple(message for message in each.inbox if message.sender not in senders))
        for name, each in received.items()
    }


def _gain(heard: Mapping[str, float], unheard: Mapping[str, float], senders: frozenset[str]) -> float:
    """Return the mean gain over the agents but a single sender itself; 0 if there is none."""
    others = [name for name in heard if name in unheard and senders != {name}]
    return float(np.mean([heard[name] - unheard[name] for name in others])) if others else 0.0
