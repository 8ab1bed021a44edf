"""The guard of a policy: asks the defence of each receiver, and remembers what it said."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial

import numpy as np

from coopsim.errors import DefenseError
from coopsim.fusion.pooling import merge_duplicates
from coopsim.geometry.se3 import Floats
from coopsim.interfaces.defense import LEAST_TRUST, Claim, Defense, Find, Reception, Trust, make_defense
from coopsim.localization.odometry import OdometryFrame
from coopsim.support.rng import stream
from coopsim.types import NS_PER_S, AgentSpec, Detections, FeatureMap, Mask, Message, Observation

MOST_SENDERS = 256
"""Most senders whose trust is remembered at a receiver: names are free to invent. Those heard last stay."""

PASSES, ASKED, DISBELIEVED = "passes of the defense", "receptions judged", "messages not believed"
"""Names of what is counted, in `Policy.counts`."""


Features = Callable[[int], "FeatureMap | None"]
"""Function from the number of a message, or -1 for the receiver itself, to its map of features."""


def no_features(number: int) -> FeatureMap | None:
    """Return None: the messages hold no maps."""
    return None


@dataclass(eq=False)
class _Receiver:
    spec: AgentSpec
    defense: Defense
    rng: np.random.Generator
    trust: dict[str, float] = field(default_factory=dict)
    known: frozenset[int] = frozenset()
    passes: int = 0


Heard = Sequence[tuple[Message, Detections]]
"""Messages, each with the objects that it claims, in the sender's base frame at capture."""

SAME_IOU = 0.15
"""BEV IoU from which the boxes of several senders are one object for a defence; that of `late_fusion`."""


class Guard:
    """The defences of all receivers of a policy.

    Args:
        defense: the option of the policy.

    Attributes:
        needs_lidar: the defence reads sweeps.
        needs_truth: the defence is told who lies.
        seconds: wall time of all judgements of the episode, with the passes that they asked for.

    Raises:
        CoopsimError: there is no such defence, or a parameter is not accepted.
    """

    def __init__(self, defense: str | Callable[[], Defense]) -> None:
        self._option = defense
        probe = make_defense(defense)
        self.needs_lidar, self.needs_truth = probe.needs_lidar, probe.needs_truth
        self.reset(0, Counter())

    def reset(self, seed: int, counts: Counter[str]) -> None:
        """Begin an episode, and forget the last one. `counts` are the policy's."""
        self._seed, self._counts, self.seconds = seed, counts, 0.0
        self._receivers: dict[str, _Receiver] = {}

    def begin(self, spec: AgentSpec) -> None:
        """Make the defence of one receiver."""
        self._receivers[spec.name] = _Receiver(
            spec, make_defense(self._option), stream(self._seed, "defense", spec.name)
        )

    def trust(self, agent: str) -> dict[str, float]:
        """Return the trust of a receiver in each sender that it has heard, as of its last frame."""
        return dict(self._receivers[agent].trust)

    def passes(self) -> dict[str, int]:
        """Return how many passes of the policy each receiver's defence asked for in its last frame."""
        return {name: receiver.passes for name, receiver in self._receivers.items()}

    def believes(self, agent: str, sender: str) -> bool:
        """Return whether a receiver believes a sender now; one that it has not heard is believed."""
        return self._receivers[agent].trust.get(sender, 1.0) >= LEAST_TRUST

    def judge(
        self,
        observation: Observation,
        agent: str,
        frame: OdometryFrame,
        heard: Heard,
        find: Find,
        features: Features = no_features,
        *,
        fuses_maps: bool = True,
    ) -> list[Mask]:
        """Return which objects of each message the receiver believes.

        Args:
            observation: the receiver's observation.
            agent: its name.
            frame: its odometry frame, moved to now.
            heard: the messages.
            find: see `Reception`.
            features: function from the number of a message, or -1 for the receiver itself, to its map.
            fuses_maps: see `Reception`.

        Raises:
            DefenseError: the defence raised, or answered something other than `Trust`.
        """
        receiver, started = self._receivers[agent], time.perf_counter()
        receiver.passes = 0
        if not observation.sensed:  # there is nothing to compare with: trust stays
            return [np.full(len(found), self.believes(agent, message.sender)) for message, found in heard]
        reception = Reception(
            spec=receiver.spec,
            observation=observation,
            odom_SE3_base=frame.odom_SE3_base,
            claims=_claims(observation, frame, heard, receiver.known, features),
            find=(ask := _Once(find)),
            rng=receiver.rng,
            own_features=partial(features, -1),
            fuses_maps=fuses_maps,
            attackers=observation.attackers if self.needs_truth else None,
        )
        receiver.known = frozenset(hash(message.identity) for message, _ in heard)
        trust = checked_trust(_ask(receiver.defense, reception), reception)
        receiver.trust = _newest(receiver.trust, dict.fromkeys(reception.senders, 1.0) | dict(trust.senders))
        receiver.passes = len(ask.known)
        self._counts[PASSES] += receiver.passes
        self.seconds += time.perf_counter() - started
        self._counts[ASKED] += 1
        believed = [self._trusted(agent, claim, trust, k) for k, claim in enumerate(reception.claims)]
        self._counts[DISBELIEVED] += sum(not self.believes(agent, claim.sender) for claim in reception.claims)
        return believed

    def judge_boxes(
        self, observation: Observation, agent: str, frame: OdometryFrame, heard: Heard, own: Detections
    ) -> list[Mask]:
        """Return which objects of each message the receiver believes, where messages hold boxes or tracks.

        What is found with some senders is then their boxes and those of the receiver, duplicates merged.
        `own` is what the receiver finds alone, in its base frame; all else is as in `judge`.
        """
        placed = frame.odom_SE3_senders([message for message, _ in heard], observation)
        base_SE3_odom = frame.odom_SE3_base.inverse()

        def find(senders: Collection[str]) -> Detections:
            among = [k for k, (message, _) in enumerate(heard) if message.sender in senders]
            groups = [heard[k][1].transform(base_SE3_odom.compose(placed[k])) for k in among]
            return merge_duplicates(Detections.concatenate([own, *groups]), SAME_IOU) if groups else own

        return self.judge(observation, agent, frame, heard, find, fuses_maps=False)

    def _trusted(self, agent: str, claim: Claim, trust: Trust, number: int) -> Mask:
        objects = np.ones(len(claim.detections)) if trust.objects is None else np.asarray(trust.objects[number])
        believed: Mask = (objects >= LEAST_TRUST) & self.believes(agent, claim.sender)
        return believed


class _Once:
    """The function `find` of one frame, which computes each answer once."""

    def __init__(self, find: Find) -> None:
        self._find = find
        self.known: dict[frozenset[str], Detections] = {}

    def __call__(self, senders: Collection[str]) -> Detections:
        asked = frozenset(senders)
        if asked not in self.known:
            self.known[asked] = self._find(asked)
        return self.known[asked]


def _claims(
    observation: Observation, frame: OdometryFrame, heard: Heard, known: frozenset[int], features: Features
) -> list[Claim]:
    """Return messages as claims, placed by the stated poses of both agents."""
    placed = frame.odom_SE3_senders([message for message, _ in heard], observation)
    base_SE3_odom, claims = frame.odom_SE3_base.inverse(), []
    for number, (message, found) in enumerate(heard):
        base_SE3_sender = base_SE3_odom.compose(placed[number])
        age_s = (observation.time_ns - message.captured_ns) / NS_PER_S
        is_new = hash(message.identity) not in known
        boxes = found.transform(base_SE3_sender)
        claims.append(Claim(message, boxes, base_SE3_sender, age_s, is_new, partial(features, number)))
    return claims


def _ask(defense: Defense, reception: Reception) -> object:
    try:
        return defense.judge(reception)
    except DefenseError:
        raise
    except Exception as error:  # a user's class may raise anything
        name, agent = type(defense).__name__, reception.spec.name
        raise DefenseError(f"{name} of {agent} raised {type(error).__name__}: {error}") from error


def checked_trust(trust: object, reception: Reception) -> Trust:
    """Return the answer of a defence if it is one. Raises `DefenseError` for any other."""
    agent = reception.spec.name
    if not isinstance(trust, Trust):
        raise DefenseError(f"a defense must answer Trust, got {type(trust).__name__} for {agent}")
    if not _are_trusts(list(trust.senders.values())):
        raise DefenseError(f"trust in senders must be in [0, 1], got {dict(trust.senders)} for {agent}")
    counts = [len(claim.detections) for claim in reception.claims]
    if trust.objects is not None:
        if [np.shape(each) for each in trust.objects] != [(count,) for count in counts]:
            raise DefenseError(f"trust in objects must be an array for each claim, of lengths {counts}, for {agent}")
        if not all(map(_are_trusts, trust.objects)):
            raise DefenseError(f"trust in objects must be in [0, 1], for {agent}")
    return trust


def _are_trusts(values: Sequence[float] | Floats) -> bool:
    numbers = np.asarray(values, dtype=np.float64)
    return bool(((numbers >= 0) & (numbers <= 1)).all())


def _newest(known: Mapping[str, float], now: Mapping[str, float]) -> dict[str, float]:
    """Return trust by sender; beyond `MOST_SENDERS` those go that were heard longest ago."""
    merged = {name: value for name, value in known.items() if name not in now}
    merged |= {name: float(value) for name, value in now.items()}
    return dict(list(merged.items())[-MOST_SENDERS:])
