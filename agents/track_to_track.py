"""Track-to-track fusion: agents share their tracks, and each receiver fuses them with its own.

By covariance intersection (Julier and Uhlmann, ACC 1997): consistent for any unknown correlation of the tracks.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from coopsim.agents.policy import Needs, Policy
from coopsim.agents.tracking_policy import nearby_messages
from coopsim.catalog import POLICIES
from coopsim.comms.envelope import decode_tracks
from coopsim.comms.uplinks.share_tracks import OwnTracks, ShareTracks
from coopsim.comms.uplinks.uplink import Uplink
from coopsim.fusion.alignment import PoseAlignment
from coopsim.fusion.track_fusion import fuse_tracks
from coopsim.geometry.boxes import covers
from coopsim.geometry.se3 import SE3Batch
from coopsim.localization.odometry import OdometryFrame
from coopsim.support.checks import require_between, require_choice, require_flag, require_number
from coopsim.tracking.ab3dmot_tracker import OnBoardTracker
from coopsim.tracking.delayed import RECEIVER
from coopsim.tracking.motion.constant_velocity import ConstantVelocity
from coopsim.tracking.track_ids import ABSENT, PublicIds
from coopsim.types import NS_PER_S, AgentSpec, Detections, Ints, Message, Observation, Tracks, seconds_to_ns
from coopsim.types.track_estimates import TrackEstimates
from coopsim.types.valid_detections import FARTHEST_M, drop_unreportable

if TYPE_CHECKING:
    from coopsim.interfaces.defense import DefenseOption

_MOTION = ConstantVelocity()
"""The motion model of received tracks, as in the tracker that they come from."""

_LONGEST_S = 10.0
"""The longest `valid_s`, and how long an unused id stays known: an agent may come back into reach with it."""


@dataclass(frozen=True, slots=True, eq=False)
class _Received:
    """The last message of one agent: its tracks in the receiver's odometry frame, as they were at capture."""

    captured_ns: int
    estimates: TrackEstimates


@dataclass
class _AgentState:
    is_object: bool
    alignment: PoseAlignment | None
    frame: OdometryFrame = field(default_factory=OdometryFrame)
    ids: PublicIds = field(default_factory=lambda: PublicIds(seconds_to_ns(_LONGEST_S)))
    received: dict[str, _Received] = field(default_factory=dict)


@POLICIES.register("track_to_track")
class TrackToTrack(Policy):
    """The agent's own tracks, fused in turn with those of each sender, predicted to now.

    Fused tracks are reported and then forgotten: they reach neither the own tracker nor the uplink, so nothing is
    counted twice. A sender's last message stays valid for a while, and the scores of its tracks fall to zero meanwhile.
    An agent tracks once per frame, for its report and for its uplink.

    Args:
        gate: smallest 3D GIoU of an own track and a detection, in [-1, 1].
        hits: frames with a detection until an own track is reported.
        age: frames without a detection until an own track is dropped.
        fuse_gate: smallest BEV GIoU of two agents' tracks of one object, in [-1, 1].
        valid_s: longest age of a message that is used, at most 10 s.
        position_noise_m: assumed standard deviation of an estimated pose's x and y.
        heading_noise_rad: assumed standard deviation of its heading. The defaults are those of V2X-ViT (Xu et al.,
            ECCV 2022): 0.2 m and 0.2 degrees.
        delayed: "predict" moves received tracks on by their velocity, "as_current" takes them as they were.
        align: correct poses by objects that several agents see, see `coopsim.fusion.alignment`.
        defense: judge of the senders, such as "plausibility" (see `coopsim.defenses`); None: all are believed.
    """

    needs = Needs(uplink="tracks")
    method = "tracks fused by covariance intersection (Julier and Uhlmann, 1997)"

    def __init__(
        self,
        gate: float = -0.2,
        hits: int = 3,
        age: int = 2,
        fuse_gate: float = -0.2,
        valid_s: float = 1.0,
        position_noise_m: float = 0.2,
        heading_noise_rad: float = 0.0035,
        delayed: str = "predict",
        align: bool = False,
        defense: DefenseOption = None,
    ) -> None:
        self.defend(defense)
        require_flag(align=align)
        require_between(-1, 1, fuse_gate=fuse_gate)
        require_number(f"in (0, {_LONGEST_S:g}]", lambda value: 0 < value <= _LONGEST_S, valid_s=valid_s)
        require_between(0, 100, position_noise_m=position_noise_m)
        require_between(0, np.pi, heading_noise_rad=heading_noise_rad)
        require_choice("delayed", delayed, ("predict", "as_current"))
        self._fuse_gate, self._valid_s, self._delayed, self._align = fuse_gate, valid_s, delayed, align
        self._pose_noise = (position_noise_m, heading_noise_rad)
        self._states: dict[str, _AgentState] = {}
        OnBoardTracker(gate, hits, age)  # so that a wrong setting is refused here, not at the first episode
        self._own = OwnTracks(partial(OnBoardTracker, gate, hits, age))

    def make_uplink(self, spec: AgentSpec, rng: np.random.Generator) -> Uplink:
        if spec.codec is not None:
            return super().make_uplink(spec, rng)
        self._own.begin_sending(spec.name)
        return ShareTracks(self._own.in_base_frame)

    def begin(self, spec: AgentSpec, rng: np.random.Generator) -> None:
        alignment = PoseAlignment.of(self.specs, spec.name) if self._align else None
        self._own.begin(spec.name)
        self._states[spec.name] = _AgentState(spec.is_object, alignment)

    def track(self, agent: str, observation: Observation) -> Tracks:
        state, now_ns = self._states[agent], observation.time_ns
        own, tracker = self._own.in_odometry_frame(agent, observation)
        state.frame = tracker.frame
        self._listen(agent, state, observation)
        fused, members = self._fused(own, self._current(list(state.received.values()), now_ns))
        public = state.ids.assign([RECEIVER, *state.received], members, now_ns)
        return replace(fused.tracks, id=public).transform(state.frame.odom_SE3_base.inverse())

    def _listen(self, agent: str, state: _AgentState, observation: Observation) -> None:
        """Keep each sender's last message, while it is valid, in order of the names."""
        read = self.read(agent, nearby_messages(observation), decode_tracks)
        if self.guard is not None:
            heard = [(message, _boxes_of(tracks)) for message, tracks in read]
            own = drop_unreportable(observation.detections)
            masks = self.guard.judge_boxes(observation, agent, state.frame, heard, own)
            read = [(message, tracks[mask]) for (message, tracks), mask in zip(read, masks, strict=True)]
        newest, captured_ns = dict[str, int](), {name: each.captured_ns for name, each in state.received.items()}
        for number, (message, _) in enumerate(read):
            sent_ns, known_ns = min(message.captured_ns, observation.time_ns), captured_ns.get(message.sender)
            if known_ns is None or sent_ns > known_ns:
                newest[message.sender], captured_ns[message.sender] = number, sent_ns
        senders = self._senders(read, observation, state)
        if newest:
            numbers = list(newest.values())
            placed = self._placed([read[number] for number in numbers], senders.take(numbers), state)
            for name, estimates in zip(newest, placed, strict=True):
                state.received[name] = _Received(captured_ns[name], estimates)
        oldest_ns = observation.time_ns - seconds_to_ns(self._valid_s)
        state.received = {name: each for name, each in sorted(state.received.items()) if each.captured_ns > oldest_ns}

    def _senders(
        self, read: Sequence[tuple[Message, TrackEstimates]], observation: Observation, state: _AgentState
    ) -> SE3Batch:
        """Return each sender's pose in the odometry frame at capture time."""
        frame = state.frame
        if state.alignment is None:
            return frame.odom_SE3_senders([message for message, _ in read], observation)
        own = drop_unreportable(observation.detections).transform(frame.odom_SE3_base)
        received = [(message, _boxes_of(each)) for message, each in read]
        return SE3Batch.of(state.alignment.place(observation, frame, own, received))

    def _placed(
        self, received: Sequence[tuple[Message, TrackEstimates]], odom_SE3_senders: SE3Batch, state: _AgentState
    ) -> list[TrackEstimates]:
        """Return received tracks in the odometry frame, with the uncertainty of two poses, less the receiver itself.

        At least one message.
        """
        frame = state.frame
        number = np.repeat(np.arange(len(received)), [len(estimates) for _, estimates in received])
        whole = TrackEstimates.concatenate([estimates for _, estimates in received])
        whole = whole.transform_each(odom_SE3_senders, number)
        away_m = whole.tracks.boxes.center[:, :2] - frame.odom_SE3_base.translation[:2]
        kept = np.abs(away_m).max(axis=1, initial=0.0) <= FARTHEST_M
        if state.is_object:
            then_m = frame.positions_at([message.captured_ns for message, _ in received])[:, :2]
            kept &= ~covers(whole.tracks.boxes, then_m[number])
        whole, number = whole[kept], number[kept]
        for origin_m in (odom_SE3_senders.translation[number, :2], frame.odom_SE3_base.translation[:2]):
            whole = whole.with_pose_noise(origin_m, *self._pose_noise)
        return whole.split(np.bincount(number, minlength=len(received)))

    def _current(self, received: Sequence[_Received], now_ns: int) -> list[TrackEstimates]:
        """Return each sender's tracks predicted to now; the older they are, the lower their scores."""
        if not received:
            return []
        counts = np.array([len(each.estimates) for each in received])
        ages_s = np.repeat([(now_ns - each.captured_ns) / NS_PER_S for each in received], counts)
        whole = TrackEstimates.concatenate([each.estimates for each in received])
        score = whole.tracks.score
        whole = replace(whole, tracks=replace(whole.tracks, score=score - np.abs(score) * ages_s / self._valid_s))
        if self._delayed == "predict" and len(whole):
            order = np.argsort(ages_s, kind="stable")
            parts = [_MOTION.predict_estimates(whole[ages_s == age_s], age_s) for age_s in np.unique(ages_s).tolist()]
            whole = TrackEstimates.concatenate(parts)[np.argsort(order)] if len(parts) > 1 else parts[0]
        return whole.split(counts)

    def _fused(self, own: TrackEstimates, others: Sequence[TrackEstimates]) -> tuple[TrackEstimates, Ints]:
        """Return N fused tracks, and each one's ids (N, 1 + senders) at the agent itself and at the senders."""
        fused, columns = own, [own.tracks.id]
        for theirs in others:
            fused, where = fuse_tracks(fused, theirs, self._fuse_gate)
            column = np.full(len(fused), ABSENT)
            column[where] = theirs.tracks.id
            columns.append(column)
        whole = [np.pad(column, (0, len(fused) - len(column)), constant_values=ABSENT) for column in columns]
        return fused, np.column_stack(whole)


def _boxes_of(estimates: TrackEstimates) -> Detections:
    """Return tracks as detections with velocities."""
    tracks = estimates.tracks
    return Detections(tracks.boxes, tracks.score, tracks.label, velocity=tracks.velocity)
