"""Feature maps and queries from a toy encoder through the real channel: latency, loss and budgets, as networks will."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy import ndimage
from small_env import SMALL

import coopsim
from coopsim.agents.boxes import AB3DMOTTracking
from coopsim.comms.envelope import decode_features, decode_queries
from coopsim.comms.uplinks.once_per_frame import EncodeOnce
from coopsim.comms.uplinks.share_features import ShareFeatures, ShareQueries
from coopsim.comms.uplinks.uplink import Uplink
from coopsim.errors import InvalidValueError
from coopsim.geometry.boxes import Boxes3D
from coopsim.types import AgentSpec, BevGrid, Detections, FeatureMap, InstanceQueries, Observation, SensorView

SHORT: dict[str, Any] = SMALL | {"max_cycles": 8}
GRID = BevGrid((-48, 48), (-24, 24), 1.5)
LATE = {"latency_s": 0.15, "latency_jitter_s": 0.05, "loss": 0.3}


def occupancy(view: SensorView) -> FeatureMap:
    """Two channels of a cell: whether it has points above the ground, and their greatest height."""
    points = np.concatenate([sweep.points for sweep in view.sweeps.values()])
    points = points[points[:, 2] > 0.3]
    cell = np.floor((points[:, :2] - [GRID.x_m[0], GRID.y_m[0]]) / GRID.cell_m).astype(int)
    inside = ((cell >= 0) & (cell < GRID.shape[::-1])).all(axis=1)
    points, (column, row) = points[inside].T, cell[inside].T
    values = np.zeros((2, *GRID.shape), np.float32)
    values[0, row, column] = 1
    np.maximum.at(values[1], (row, column), points[2])
    return FeatureMap(values, GRID, values[0] * 0.5 + 0.5 * np.minimum(values[1] / 4, 1))


class Fusing(AB3DMOTTracking):
    """Warps others' features into its own frame, and sees whether they fit the points; the boxes are the detector's."""

    needs = coopsim.Needs(uplink="features", lidar=True)

    def __init__(self, codec: str = "features") -> None:
        super().__init__()
        self.encoded: Counter[tuple[str, int]] = Counter()
        self.delays_ns: list[int] = []
        self.views: dict[tuple[str, int], SensorView] = {}
        self.fit: tuple[list[bool], list[bool]] = ([], [])
        self._codec, self._encode = codec, EncodeOnce(self._encode_one)

    def _encode_one(self, view: SensorView) -> FeatureMap:
        self.encoded[view.agent, view.time_ns] += 1
        self.views[view.agent, view.time_ns] = view
        return occupancy(view)

    def make_uplink(self, spec: AgentSpec, rng: np.random.Generator) -> Uplink:
        return ShareFeatures(self._encode, spec.codec or self._codec)

    def perceive(self, agent: str, observation: Observation) -> Detections:
        self._encode(observation.view(self.specs[agent]))
        base_SE3_world = observation.pose.world_SE3_base.inverse()
        for message, features in self.read(agent, observation.inbox, decode_features):
            features.require_grid(GRID)
            base_SE3_sender = base_SE3_world.compose(message.pose.world_SE3_base)
            moved, mask = features.warp(GRID, base_SE3_sender)
            view = self.views[message.sender, message.captured_ns]
            sweeps = {
                name: replace(sweep, points=base_SE3_sender.apply(sweep.points)) for name, sweep in view.sweeps.items()
            }
            around = ndimage.binary_dilation(occupancy(replace(view, sweeps=sweeps)).values[0], np.ones((3, 3)))
            for fit, each in zip(self.fit, (moved, features), strict=True):
                fit += around[(each.values[0] > 0.5) & mask].tolist()
            self.delays_ns.append(observation.time_ns - message.captured_ns)
        return super().perceive(agent, observation)


def test_a_feature_map_is_encoded_once_per_agent_and_frame() -> None:
    policy = Fusing()
    for _ in range(2):
        policy.encoded.clear()
        result = coopsim.evaluate(policy, seed=3, **SHORT)
        agents = len(policy.specs)
        assert len(policy.encoded) == 9 * agents and set(policy.encoded.values()) == {1}
    assert result.messages.rejected == 0 and not any(policy.delays_ns)
    assert result.score["TP"] == coopsim.evaluate("no_fusion", seed=3, **SHORT).score["TP"]


def test_features_fit_where_their_grid_and_poses_put_them() -> None:
    policy = Fusing("features(number=int8)")
    coopsim.evaluate(policy, seed=3, **SHORT)
    warped, unmoved = map(np.mean, policy.fit)
    assert warped > 0.97 and unmoved < 0.8


def test_features_are_delayed_and_lost_as_anything_else() -> None:
    policy = Fusing()
    result = coopsim.evaluate(policy, seed=3, **SHORT, **LATE)
    assert result.messages.lost > 0 and min(policy.delays_ns) > 0
    assert len(policy.delays_ns) <= result.messages.delivered


def test_a_budget_leaves_the_surest_cells(sizes: list[int]) -> None:
    policy = Fusing()
    coopsim.evaluate(policy, seed=3, codec="sparse_features(most_cells=2000)", budget_bytes=1500, **SHORT)
    assert sizes and 1400 < max(sizes) <= 1500
    assert policy.fit[0] and not policy.rejected


def test_dense_features_have_no_budget() -> None:
    with pytest.raises(InvalidValueError, match="not for ShareFeatures; accepted codecs: sparse_features"):
        coopsim.evaluate(Fusing(), seed=3, budget_bytes=1500, **SHORT)


def test_another_grid_is_refused_with_both_grids_told() -> None:
    other = FeatureMap(np.zeros((1, 8, 8)), BevGrid((0, 8), (0, 8), 1.0))
    with pytest.raises(InvalidValueError, match=r"grid x -48 to 48 m, .* of 1.5 m, got x 0 to 8 m, .* of 1 m"):
        other.require_grid(GRID)


class Queries(AB3DMOTTracking):
    """Sends a query for each detection; tracks its own and, as boxes, those of others."""

    needs = coopsim.Needs(uplink="queries")

    def __init__(self) -> None:
        super().__init__()
        self.received: list[InstanceQueries] = []

    def make_uplink(self, spec: AgentSpec, rng: np.random.Generator) -> Uplink:
        def encode(view: SensorView) -> InstanceQueries:
            count = 3 + view.time_ns // 100_000_000 % 5
            boxes = Boxes3D.from_array(np.tile([10.0, 2, 0.8, 4.5, 1.9, 1.6, 0], (count, 1)))
            return InstanceQueries(
                np.full((count, 32), count), boxes, np.linspace(0.1, 0.9, count), np.zeros(count, int)
            )

        return ShareQueries(encode, spec.codec or "queries")

    def perceive(self, agent: str, observation: Observation) -> Detections:
        self.received += [queries for _, queries in self.read(agent, observation.inbox, decode_queries)]
        return super().perceive(agent, observation)


def test_queries_arrive_and_a_budget_leaves_the_surest(sizes: list[int]) -> None:
    policy = Queries()
    coopsim.evaluate(policy, seed=3, **SHORT, **LATE)
    assert {len(each) for each in policy.received} <= set(range(3, 8)) and policy.received
    assert all((each.feature == len(each)).all() for each in policy.received)
    policy.received.clear()
    sizes.clear()
    coopsim.evaluate(policy, seed=3, codec="queries(number=int8)", budget_bytes=300, **SHORT)
    assert max(sizes) <= 300
    assert {len(each) for each in policy.received} == {3}
    assert all(each.score.min() > 0.3 for each in policy.received if each.feature[0, 0] > 3)
    assert not policy.rejected
