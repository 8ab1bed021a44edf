"""Correction of senders' poses by the objects that they and the receiver both see.

In each frame: the receiver's own pose is smoothed along its odometry; the boxes of each message are matched with those
that the receiver (and other senders) saw at its capture; a pose graph of agents and objects is solved; and a filter per
sender carries the correction on, as far as the error lasts.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from coopsim.fusion.common_objects import ANYTHING, CommonObjects, PlacedBoxes, common_objects, consensus
from coopsim.fusion.pose_graph import Corrections, PoseGraph, align
from coopsim.geometry.se3 import SE3, Floats, wrap_angle
from coopsim.localization.odometry import OdometryFrame
from coopsim.types import NS_PER_S, AgentSpec, Detections, Message, Observation, Odometry, PoseEstimate, stack_xyz_yaw

_KNOWN_NS = 60 * NS_PER_S
"""Time for which the pose error of a silent agent is kept; bounded, because names may change for ever."""

_MEMORY_NS = 2 * NS_PER_S
_GATES_M = (2.0, 1.0)
"""Largest distance of two boxes on one object: under the consensus, and once the poses are corrected by it."""

_ASSUMED = np.square([0.5, 0.5, np.radians(0.5)])
"""Variance of a pose that comes without a covariance, x, y (m^2) and heading (rad^2)."""

_BOX_NOISE_M = 0.25


ReceivedBoxes = tuple[Message, Detections]
"""A message, with its sender, capture time and stated pose, and its valid boxes in the sender's base frame."""


@dataclass
class PoseAlignment:
    """Corrections of all senders' poses by one receiver, over one episode.

    Attributes:
        is_object: for each agent, whether others see it as an object over the origin of its base frame.
        receiver: name of the receiver.
        min_common: a message with fewer common objects is placed by the correction known from before.
    """

    is_object: Mapping[str, bool]
    receiver: str
    min_common: int = 2
    _own: OwnPose | None = None
    _senders: dict[str, PoseErrorFilter] = field(default_factory=dict)
    _own_boxes: dict[int, PlacedBoxes] = field(default_factory=dict)
    _used_ns: dict[str, int] = field(default_factory=dict)

    @classmethod
    def of(cls, specs: Mapping[str, AgentSpec], receiver: str) -> PoseAlignment:
        """Return the alignment of one of these agents, as the receiver."""
        return cls({name: spec.is_object for name, spec in specs.items()}, receiver)

    def place(
        self, observation: Observation, frame: OdometryFrame, own: Detections, received: Sequence[ReceivedBoxes]
    ) -> list[SE3]:
        """Return `odom_SE3_sender` at capture for each message. To be called once in each frame, in order.

        `frame` is the receiver's odometry frame, moved to now, and `own` are its detections in it.
        """
        self._remember(observation, frame, own)
        odom_SE3_world = frame.odom_SE3_base.compose(self._own_pose(observation).inverse())
        stated = [odom_SE3_world.compose(message.pose.world_SE3_base) for message, _ in received]
        placed: list[SE3] = list(stated)
        for captured_ns in sorted({message.captured_ns for message, _ in received}):
            now = [row for row, (message, _) in enumerate(received) if message.captured_ns == captured_ns]
            # The same message twice is one, and the graph has each agent once.
            senders = {received[row][0].sender: row for row in now}
            rows = [senders[name] for name in sorted(senders)]
            found = self._corrections(
                captured_ns, [received[row] for row in rows], [stated[row] for row in rows], observation
            )
            by_sender = {received[row][0].sender: each for row, each in zip(rows, found, strict=True)}
            for row in now:
                placed[row] = _corrected(stated[row], by_sender[received[row][0].sender])
        return placed

    def covariance(self, sender: str) -> Floats | None:
        """Return the covariance (3, 3) of where a sender's last message was placed: x, y (m) and heading (rad).

        None: nothing came from this sender, or too long ago.
        """
        known = self._senders.get(sender)
        return None if known is None else known.covariance

    def _own_pose(self, observation: Observation) -> SE3:
        """Return the receiver's smoothed pose, `world_SE3_base`."""
        if self._own is None:
            self._own = OwnPose(observation.pose, _variance(observation.pose))
            return observation.pose.world_SE3_base
        return self._own.step(observation.pose, observation.odometry)

    def _remember(self, observation: Observation, frame: OdometryFrame, own: Detections) -> None:
        """Remember the receiver's boxes of now, and forget old ones and silent senders."""
        now_ns = observation.time_ns
        self._own_boxes = {
            time_ns: boxes for time_ns, boxes in self._own_boxes.items() if time_ns >= now_ns - _MEMORY_NS
        }
        self._own_boxes[now_ns] = _placed_boxes(own, frame.odom_SE3_base, is_object=self.is_object[self.receiver])
        self._used_ns = {name: used_ns for name, used_ns in self._used_ns.items() if used_ns >= now_ns - _KNOWN_NS}
        self._senders = {name: self._senders[name] for name in self._used_ns}

    def _corrections(
        self, captured_ns: int, received: Sequence[ReceivedBoxes], stated: Sequence[SE3], observation: Observation
    ) -> list[Floats]:
        """Return the correction (3,) of each message of one moment: x, y m in the odometry frame and heading rad."""
        news = [captured_ns > self._used_ns.get(message.sender, -1) for message, _ in received]
        filters = [self._filter(message, captured_ns, observation.pose) for message, _ in received]
        agents = [self._own_boxes[min(self._own_boxes, key=lambda known_ns: abs(known_ns - captured_ns))]]
        agents += [
            _placed_boxes(found.transform(place), place, is_object=self.is_object.get(message.sender, False))
            for (message, found), place in zip(received, stated, strict=True)
        ]
        prior = Corrections(np.array([each.mean for each in filters]), np.array([each.covariance for each in filters]))
        guess: Iterable[Floats] = _coarse(agents, prior)
        for gate_m in _GATES_M:
            common = common_objects(agents, [np.zeros(3), *guess], gate_m)
            if not len(common.agent):
                break
            aligned = align(_graph(agents, common), prior, _BOX_NOISE_M)
            guess = aligned.mean
        corrections = [each.mean for each in filters]
        for number, (one, new) in enumerate(zip(filters, news, strict=True)):
            if common.of_agent(number + 1) >= self.min_common:
                corrections[number] = aligned.mean[number]
                if new:  # an overtaken or repeated message carries no new information
                    one.update(aligned.mean[number], aligned.covariance[number])
        return corrections

    def _filter(self, message: Message, captured_ns: int, own: PoseEstimate) -> PoseErrorFilter:
        """Return the sender's filter, predicted to this message."""
        name = message.sender
        if name not in self._senders:
            self._senders[name] = PoseErrorFilter(_variance(message.pose) + _variance(own))
        elif captured_ns > self._used_ns[name]:
            self._senders[name].predict()
        self._used_ns[name] = max(captured_ns, self._used_ns.get(name, captured_ns))
        return self._senders[name]


def _coarse(agents: Sequence[PlacedBoxes], prior: Corrections) -> list[Floats]:
    """Return the consensus of each sender with the objects that the receiver and the senders before it saw."""
    known, label = agents[0].position, agents[0].label
    corrections = []
    for boxes, mean, covariance in zip(agents[1:], prior.mean, prior.covariance, strict=True):
        correction = consensus(known, label, boxes, mean, np.sqrt(np.diagonal(covariance)))
        corrections.append(correction)
        known = np.concatenate([known, boxes.corrected(correction)])
        label = np.concatenate([label, boxes.label])
    return corrections


def _graph(agents: Sequence[PlacedBoxes], common: CommonObjects) -> PoseGraph:
    """Return the pose graph of the common objects."""
    origins = np.array([boxes.origin for boxes in agents])
    first = np.cumsum([0, *(len(boxes) for boxes in agents)])
    position = np.concatenate([boxes.position for boxes in agents])[first[common.agent] + common.row]
    origin = origins[common.agent]
    return PoseGraph(position - origin, origin, common.agent, common.object)


def _placed_boxes(detections: Detections, odom_SE3_base: SE3, *, is_object: bool) -> PlacedBoxes:
    """Return boxes in the odometry frame, and the agent itself where others see it as an object."""
    position, origin = detections.boxes.center[:, :2], odom_SE3_base.translation[:2]
    if not is_object:
        return PlacedBoxes(origin, position, detections.label)
    return PlacedBoxes(origin, np.concatenate([position, origin[None]]), np.append(detections.label, ANYTHING))


def _variance(pose: PoseEstimate) -> Floats:
    """Return the variances (3,) of x, y (m^2) and heading (rad^2), as stated or assumed."""
    return _ASSUMED if pose.covariance is None else np.diagonal(pose.covariance)


def _corrected(odom_SE3_sender: SE3, correction: Floats) -> SE3:
    """Return a pose moved by a correction (3,): x, y m and heading rad."""
    xyz = odom_SE3_sender.translation + np.array([correction[0], correction[1], 0.0])
    return SE3.from_xyz_yaw(xyz, odom_SE3_sender.yaw + float(correction[2]))


_KEPT = 0.97
"""Share of the learned moments that is kept from one message to the next: some three seconds at 10 Hz."""

_FRAMES = 5.0
"""Number of frames that the assumed or stated variance counts for."""

_LEAST = np.square([0.02, 0.02, 0.0004])
"""Smallest variance of x, y (m^2) and heading (rad^2)."""

_MOST_R = 0.99


class ErrorProcess:
    """Variance and correlation of a zero-mean process that is measured with known noise; x and y are alike.

    A pose's noise may be fresh in every frame (the papers' protocol), wander or stay, and which of them is unknown. All
    three are a process e_t = r e_(t-1) + sqrt(1 - r^2) v_t with variance V (AR(1); an Ornstein-Uhlenbeck process in
    frames), with r = 0 for white noise and r = 1 for a bias. V and r are learned from the measurements, by moments.
    They set the gain: with r = 0 an error is found from this frame's objects alone, with r = 1 from all frames'.

    It begins with an assumed or stated variance (3,) of x, y (m^2) and heading (rad^2).
    """

    def __init__(self, variance: Floats) -> None:
        self._first = np.maximum(variance, _LEAST)
        self._weight, self._square, self._product = np.zeros(3), np.zeros(3), np.zeros(3)
        self._before: Floats | None = None

    @property
    def variance(self) -> Floats:
        """The variance V (3,)."""
        learned = (_FRAMES * self._first + self._square) / (_FRAMES + self._weight)
        return np.maximum(_alike(learned), _LEAST)

    @property
    def correlation(self) -> Floats:
        """The correlation r (3,), in [0, 0.99]."""
        power = np.maximum(_alike(self._square), 0.0) + self.variance  # one more frame, with no correlation
        return np.clip(_alike(self._product) / power, 0.0, _MOST_R)

    def forget(self) -> None:
        """Discount the moments by one frame."""
        for sums in (self._weight, self._square, self._product):
            sums *= _KEPT

    def learn(self, value: Floats, noise: Floats) -> None:
        """Add a measurement (3,) with the variance (3,) of its noise; a noisy measurement counts little."""
        weight = self.variance / (self.variance + noise)
        self._weight += weight
        self._square += weight * (value**2 - noise)
        if self._before is not None:
            self._product += weight * value * self._before
        self._before = value


def _alike(values: Floats) -> Floats:
    """Average the values of x and y."""
    planar = (values[0] + values[1]) / 2
    return np.array([planar, planar, values[2]])


class PoseErrorFilter:
    """A Kalman filter of one agent's correction (x, y, heading), with a learned model.

    Attributes:
        mean: (3,) the correction, m and rad.
        covariance: (3, 3).
    """

    def __init__(self, variance: Floats) -> None:
        self._process = ErrorProcess(variance)
        self.mean, self.covariance = np.zeros(3), np.diag(self._process.variance)

    def predict(self) -> None:
        """Predict the correction to the next message."""
        self._process.forget()
        kept = self._process.correlation
        fresh = np.diag((1 - kept**2) * self._process.variance)
        self.mean, self.covariance = kept * self.mean, np.outer(kept, kept) * self.covariance + fresh

    def update(self, mean: Floats, covariance: Floats) -> None:
        """Take over the correction (3,) and covariance (3, 3) estimated from prediction and this frame's objects."""
        prior, posterior = np.linalg.inv(self.covariance), np.linalg.inv(covariance)
        # The objects' information alone is the posterior's less the prediction's. A direction without any would make it
        # singular: it gets next to no weight.
        data = posterior - prior + np.diag(1e-3 / self._process.variance)
        noise = np.linalg.inv(data)
        measured = noise @ (posterior @ mean - prior @ self.mean)
        if np.isfinite(measured).all() and (np.diagonal(noise) > 0).all():
            self._process.learn(measured, np.diagonal(noise))
        self.mean, self.covariance = mean, covariance


class OwnPose:
    """An agent's own pose, with its white noise averaged out along the odometry.

    The gain follows from the scatter of the stated pose about the pose that odometry carries on: an error that wanders
    or stays scatters little, is followed, and is left to the shared objects.

    Attributes:
        xyz_yaw: (4,) the pose, m and rad.
    """

    def __init__(self, first: PoseEstimate, variance: Floats) -> None:
        self.xyz_yaw = first.xyz_yaw
        self._variance = np.maximum(variance, _LEAST)
        self._process = ErrorProcess(variance)

    def step(self, stated: PoseEstimate, odometry: Odometry) -> SE3:
        """Return the pose one frame later, `world_SE3_base`: carried on by odometry and drawn to the stated pose."""
        before = SE3.from_xyz_yaw(self.xyz_yaw[:3], float(self.xyz_yaw[3]))
        carried = stack_xyz_yaw(before.compose(odometry.previous_SE3_current))
        surprise = stated.xyz_yaw - carried
        surprise[3] = wrap_angle(surprise[3])
        predicted = self._variance + _STEP
        self._process.forget()
        self._process.learn(surprise[[0, 1, 3]], predicted)
        gain = predicted / (predicted + self._process.variance)
        self._variance = (1 - gain) * predicted
        self.xyz_yaw = carried + np.array([gain[0], gain[1], 1.0, gain[2]]) * surprise
        return SE3.from_xyz_yaw(self.xyz_yaw[:3], float(self.xyz_yaw[3]))


_STEP = np.square([0.01, 0.01, 0.0005])
"""Variance of a frame's odometry, m^2 and rad^2: twice the default noise of `LocalizationConfig`."""
