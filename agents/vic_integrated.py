"""Integrated detection and tracking of Hu, Wang and Wang, "Integrated Detection and Tracking Framework for 3D
Multi-Object Tracking in Vehicle-Infrastructure Cooperation", eq. 5-27: a fused map, enhanced by that of the frame
before; a branch that detects, and one that finds the last frame's objects again; four stages of matching.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from coopsim.agents.learned_fusion import LearnedFusion
from coopsim.agents.perceiving_policy import FrameChain, Received, base_SE3_compass
from coopsim.agents.tracking_policy import policy_row
from coopsim.errors import InvalidValueError
from coopsim.support.checks import require_choice, require_count, require_finite_number, require_probability
from coopsim.tracking.cascade import AFFINITIES, Cascade, Stage, four_stages
from coopsim.tracking.lifecycle import HitsAndAge
from coopsim.types import AgentSpec, Detections, Observation, Tracks
from coopsim.types.valid_detections import drop_unreportable

if TYPE_CHECKING:
    from coopsim.nn.cooperative.cooperative_net import CooperativeNet
    from coopsim.nn.detector.detector_net import DetectorNet
    from coopsim.nn.integrated.perceiver import IntegratedState, TrackRules

INTEGRATED = "integrated"
"""The tracker for which the prediction branch says where tracks are."""


@policy_row("vic_integrated")
class VicIntegrated(LearnedFusion):
    """Detection and tracking by one network on fused maps. Further parameters: `LearnedFusion`.

    In each frame the detection branch finds objects with scores s_d, and the prediction branch finds the tracks of the
    frame before, with scores s_t of being seen now. Both are matched by XIOU in four stages.

    Attributes:
        tracker: "integrated": tracks are where the prediction branch finds them; or a policy that tracks boxes, whose
            tracker then follows what the detection branch finds, as "vic_fscm_association".
        stages: 4 of matching (FSCM), or 1 in which all tracks and detections take part.
        affinity: similarity of boxes: "axial_xiou", XIOU in which front and back are alike, for the heads of
            LiDAR networks confuse them; "xiou", the paper's; or "giou", (GIoU + 1) / 2, which knows no headings.
        gate: smallest affinity of a match, in [0, 1]; ours, the paper gives none.
        detection_score: score from which a detection is sure, and begins a track (m_d); the paper's is 0.5.
        track_score: score from which a track is sure (m_t); the paper's is 0.4.
        keep: frames for which a track without a detection is kept (N).
        hits: frames with a detection until a track is reported; ours, the paper gives none.
    """

    method = "Hu et al.'s integrated detection and tracking (eq. 5-27), on LiDARs, for any number of agents"

    own_tracker = INTEGRATED

    weights: str = "vic_integrated"
    tracker: str = INTEGRATED
    stages: int = 4
    affinity: str = "axial_xiou"
    gate: float = 0.4
    detection_score: float = 0.3
    track_score: float = 0.2
    keep: int = 20
    hits: int = 3

    def __post_init__(self) -> None:
        if self.stages not in (1, 4):
            raise InvalidValueError(f"stages must be 1 or 4, got {self.stages!r}")
        require_choice("affinity", self.affinity, AFFINITIES)
        require_probability(gate=self.gate)
        require_finite_number(detection_score=self.detection_score, track_score=self.track_score)
        require_count(1, keep=self.keep, hits=self.hits)
        super().__post_init__()

    def load_net(self, detector: DetectorNet) -> CooperativeNet:
        from coopsim.learn.weights import load_integrated
        from coopsim.nn.integrated.perceiver import IntegratedPerceiver

        net = load_integrated(self.weights, detector)
        rules = self._rules(net.config.places) if self.tracker == INTEGRATED else None
        self._integrated, self._track_rules = IntegratedPerceiver(net, rules, self._backend), rules
        self._chains: dict[str, FrameChain[IntegratedState]] = {}
        return net.cooperative

    def begin(self, spec: AgentSpec, rng: np.random.Generator) -> None:
        super().begin(spec, rng)
        self._chains[spec.name] = FrameChain()

    def find(self, agent: str, observation: Observation, received: Sequence[Received]) -> Detections:
        from coopsim.nn.queries.perceiver import detections_of

        chain, now_ns = self._chains[agent], observation.time_ns
        before = chain.begin(now_ns)
        fused, region = self.fused(agent, observation, received)
        odom_SE3_compass = self.odom_SE3_compass(agent, observation)
        chain.now = self._integrated.step(before, now_ns, odom_SE3_compass, fused, region)
        found = detections_of(chain.now.detected)
        return found[found.score >= self.least_score]

    def _follow(self, agent: str, observation: Observation, found: Detections) -> Tracks:
        rules, state, memory = self._track_rules, self._states[agent], self._chains[agent].now
        if rules is None:
            return super()._follow(agent, observation, found)
        state.fused = [drop_unreportable(found).transform(state.frame.odom_SE3_base)]
        if memory is None:
            return Tracks.empty()
        return self._reported(agent, observation, memory, rules)

    def _reported(self, agent: str, observation: Observation, memory: IntegratedState, rules: TrackRules) -> Tracks:
        """Return the tracks that are reported, in the base frame; in a frame without sensors, moved on to it."""
        from coopsim.nn.queries.perceiver import detections_of, tracks_of

        to_base = base_SE3_compass(observation)
        tracks = memory.at(observation.time_ns, self.odom_SE3_compass(agent, observation))
        rows = np.flatnonzero(rules.reported(tracks, memory.frame))
        shown = detections_of(tracks)[rows]
        numbered = replace(shown, embedding=rows[:, None].astype(np.float64)).transform(to_base)
        received = list(self._received[agent].values())
        own = drop_unreportable(self._less_itself(agent, observation.time_ns, received, numbered))
        return tracks_of(tracks, own, to_base)

    def _rules(self, most: int) -> TrackRules:
        from coopsim.geometry.assignment import hungarian
        from coopsim.nn.integrated.perceiver import TrackRules

        affinity = AFFINITIES[self.affinity]
        if self.stages == 4:
            association = four_stages(affinity, self.gate, self.track_score, self.detection_score)
        else:
            association = Cascade([Stage(affinity, hungarian, self.gate)])
        return TrackRules(association, HitsAndAge(self.hits, self.keep, coast=1), self.detection_score, most)
