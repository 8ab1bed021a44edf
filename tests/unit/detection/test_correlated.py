"""The detector whose errors last, and its clutter: each number does what its docstring says."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from coopsim.detection.oracle import Oracle, OracleDetector, Oracles
from coopsim.detection.presets import make_detector, preset
from coopsim.detection.simulated.clutter import Clutter, ClutterConfig
from coopsim.detection.simulated.correlated import ERRORS, CorrelatedDetector, CorrelatedDetectorConfig
from coopsim.detection.simulated.curves import Curve, DetectionModel, ErrorModel, ScoreModel
from coopsim.detection.simulated.persistence import Persistence
from coopsim.errors import InvalidValueError, UnknownNameError
from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.se3 import SE3, SE3Batch, wrap_angle
from coopsim.types import AgentSpec, Detections, Odometry, SensorView
from coopsim.world.snapshot import Actors

RNG = np.random.default_rng(0)
"""Given as every detector's, and not used by this one."""


def flat(value: float) -> Curve:
    return Curve((0.0,), (value,))


EXACT = CorrelatedDetectorConfig(
    reach_x_m=100.0,
    reach_y_m=100.0,
    detection=DetectionModel(flat(1.0)),
    score=ScoreModel(0.2, flat(0.0), flat(0.5)),
    errors={name: ErrorModel(flat(0.0)) for name in ERRORS},
)
PHANTOMS = ClutterConfig(0.004, DetectionModel(flat(0.5)), ScoreModel(0.2, flat(0.0), flat(1.0)), life_s=1e6)


def actors(count: int, range_m: float = 30.0, yaw: float = 0.3) -> Actors:
    bearing = np.linspace(-np.pi, 3.0, count)  # no two of the same x or y
    center = np.column_stack([range_m * np.cos(bearing), range_m * np.sin(bearing), np.full(count, 0.8)])
    boxes = Boxes3D(center, np.tile([4.5, 1.9, 1.6], (count, 1)), np.full(count, yaw))
    zeros = np.zeros(count, dtype=np.int64)
    return Actors(np.arange(1, count + 1), boxes, np.zeros((count, 2)), zeros, zeros, np.zeros((count, 3), np.uint8))


def specs(*agents: str) -> dict[str, AgentSpec]:
    return {agent: AgentSpec(agent, "cav", 0.1, "none") for agent in agents}


def view(agent: str) -> SensorView:
    return SensorView(agent, 0, Odometry(np.zeros(4)))


def detect(config: CorrelatedDetectorConfig, truth: Actors, returns: int = 50, frames: int = 1) -> list[Detections]:
    detector = CorrelatedDetector(config).begin(specs("cav_0"), seed=5)
    oracle = Oracle(truth, np.full(len(truth), returns), SE3.identity())
    return [detector.detect(view("cav_0"), oracle, RNG) for _ in range(frames)]


def test_without_errors_it_reports_the_truth() -> None:
    (found,) = detect(EXACT, actors(20))
    np.testing.assert_allclose(found.boxes.array, actors(20).boxes.array)
    assert found.score.min() > 0.2


def test_recall_is_the_curve_over_returns_and_zero_without_any() -> None:
    config = replace(EXACT, detection=DetectionModel(Curve((0.0, np.log(100)), (0.2, 0.8))))
    for returns, expected in ((0, 0.0), (1, 0.2), (10, 0.5), (1000, 0.8)):
        assert len(detect(config, actors(5000), returns)[0]) / 5000 == pytest.approx(expected, abs=0.02)


def test_misses_last() -> None:
    config = replace(EXACT, detection=DetectionModel(flat(0.5), Persistence(0.5, 0.4, 1.0)))
    truth = actors(4000)
    first, second = (
        np.isin(np.round(truth.boxes.center[:, 1], 6), np.round(found.boxes.center[:, 1], 6))
        for found in detect(config, truth, frames=2)
    )
    assert first.mean() == pytest.approx(0.5, abs=0.03)
    # Two standard normals of correlation c have one sign with probability 1/2 + asin(c) / pi.
    kept = 0.5 + 0.4 * np.exp(-0.1)
    assert (first == second).mean() == pytest.approx(0.5 + np.arcsin(kept) / np.pi, abs=0.03)


def test_nothing_is_found_beyond_reach() -> None:
    config = replace(EXACT, reach_x_m=20.0, reach_y_m=10.0)
    assert len(detect(config, actors(100, range_m=23.0))[0]) == 0
    found = detect(config, actors(100, range_m=15.0))[0].boxes.center
    assert 0 < len(found) < 100 and np.abs(found[:, 1]).max() <= 10.0


def test_scores_have_their_floor_and_go_with_the_evidence_and_keep_their_distribution() -> None:
    truth = actors(20_000)
    logits = []
    for clearness in (0.0, 0.9):
        scored = ScoreModel(0.3, flat(-0.5), flat(0.7), clearness)
        (found,) = detect(replace(EXACT, detection=DetectionModel(flat(0.4)), score=scored), truth)
        assert found.score.min() >= 0.3
        unfloored = (found.score - 0.3) / 0.7
        logits.append(np.log(unfloored / (1 - unfloored)))
    for logit in logits:
        assert logit.mean() == pytest.approx(-0.5, abs=0.03) and logit.std() == pytest.approx(0.7, abs=0.03)


def test_errors_have_their_axis_spread_middle_and_tail() -> None:
    for name, column in (("along", 0), ("across", 1), ("up", 2), ("yaw", 6)):
        errors = dict(EXACT.errors) | {name: ErrorModel(Curve((0.0, 60.0), (0.0, 0.2)), flat(0.02), tail=0.2)}
        truth = actors(20_000, yaw=0.0)
        off = detect(replace(EXACT, errors=errors), truth)[0].boxes.array - truth.boxes.array
        assert np.abs(np.delete(off, column, axis=1)).max() < 1e-12
        assert np.median(off[:, column]) == pytest.approx(0.02, abs=0.003)
        quantiles = np.quantile(off[:, column] - 0.02, [0.8413447, 0.9772499])
        np.testing.assert_allclose(quantiles, [0.1 * np.exp(0.1), 0.2 * np.exp(0.4)], rtol=0.05)


def test_a_detector_that_does_not_tell_front_from_back_folds_headings() -> None:
    config = replace(EXACT, heading_from_rad=-0.8)
    for yaw in (0.0, 2.0, 3.0, -1.0, -2.5):
        reported = detect(config, actors(1, yaw=yaw))[0].boxes.yaw[0]
        assert -0.8 <= reported < np.pi - 0.8
        assert abs(np.sin(reported - yaw)) < 1e-9


def test_the_axes_of_errors_turn_with_the_object() -> None:
    errors = dict(EXACT.errors) | {"along": ErrorModel(flat(0.3))}
    config = replace(EXACT, errors=errors)
    shifts = [
        detect(config, actors(50, yaw=yaw))[0].boxes.center[:, :2] - actors(50).boxes.center[:, :2]
        for yaw in (0.0, np.pi / 2)
    ]
    np.testing.assert_allclose(shifts[0][:, 0], shifts[1][:, 1], atol=1e-12)


def phantoms(clutter: Clutter, pose: SE3 | None = None, solid_m: np.ndarray | None = None) -> Detections:
    """One frame of the only agent's."""
    pose, solid_m = pose or SE3.identity(), np.zeros((0, 2)) if solid_m is None else solid_m
    return clutter.detect(
        np.zeros(1, np.int64), [pose], SE3Batch.of([pose.inverse()]), np.array([0, len(solid_m)]), solid_m
    ).detections


def test_phantoms_stay_in_the_world_while_the_agent_moves() -> None:
    clutter = Clutter(
        replace(PHANTOMS, detection=DetectionModel(flat(1.0))), 0, ["cav_0"], [0.1], np.array([60.0, 40.0])
    )
    seen = []
    for pose in (SE3.identity(), SE3.from_xyz_yaw(np.array([7.0, -3.0, 0.1]), 0.4)):
        found = phantoms(clutter, pose)
        floor_m = pose.apply(found.boxes.center)[:, 2] - found.boxes.size[:, 2] / 2
        np.testing.assert_allclose(floor_m, 0.0, atol=1e-12)  # on a hump, too
        seen.append({tuple(place) for place in np.round(pose.apply(found.boxes.center)[:, :2], 6)})
    assert len(seen[0] & seen[1]) > 0.6 * len(seen[0]) > 10


def test_phantoms_are_common_to_agents_who_believe_in_them_by_themselves() -> None:
    reach, numbers, shared = np.array([60.0, 40.0]), [], []
    for seed in range(20):
        both = (phantoms(Clutter(PHANTOMS, seed, [name], [0.1], reach)) for name in "ab")
        one, other = ({tuple(place) for place in np.round(each.boxes.center[:, :2], 6)} for each in both)
        numbers += [len(one), len(other)]
        shared.append(len(one & other))
    believed = PHANTOMS.density_per_m2 * 4 * reach.prod() * 0.5
    assert np.mean(numbers) == pytest.approx(believed, rel=0.1)
    assert np.mean(shared) == pytest.approx(believed * 0.5, rel=0.15)


def test_phantoms_die_and_others_come_at_the_same_rate() -> None:
    config = replace(PHANTOMS, detection=DetectionModel(flat(1.0)), life_s=1.0)
    clutter = Clutter(config, 0, ["cav_0"], [0.1], np.array([60.0, 40.0]))
    frames = [phantoms(clutter).boxes.center[:, 0] for _ in range(31)]
    assert len(np.intersect1d(frames[0], frames[5])) == pytest.approx(0.5 * len(frames[0]), abs=0.25 * len(frames[0]))
    assert len(np.intersect1d(frames[0], frames[10])) == 0
    assert len(frames[30]) == pytest.approx(len(frames[0]), rel=0.5)


def test_no_phantom_stands_beside_a_real_object() -> None:
    clutter = [Clutter(PHANTOMS, 0, ["cav_0"], [0.1], np.array([60.0, 40.0])) for _ in range(2)]
    free = phantoms(clutter[0])
    beside = phantoms(clutter[1], solid_m=free.boxes.center[:3, :2] + 1.0)
    assert set(beside.boxes.center[:, 0]) == set(free.boxes.center[3:, 0])


def test_every_agent_and_episode_has_its_own_memory() -> None:
    detector = CorrelatedDetector(preset("pointpillars_v2v4real"))
    truth, returns = actors(30), np.full(30, 100)

    def three_frames(seed: int, agent: str) -> list[Detections]:
        begun = detector.begin(specs("cav_0", "cav_1"), seed)
        oracle = Oracle(truth, returns, SE3.identity())
        return [begun.detect(view(agent), oracle, RNG) for _ in range(3)]

    first, again, other = three_frames(1, "cav_0"), three_frames(1, "cav_0"), three_frames(1, "cav_1")
    for one, two in zip(first, again, strict=True):
        np.testing.assert_array_equal(one.boxes.array, two.boxes.array)
    assert not np.isin(first[0].boxes.center[:, 0], other[0].boxes.center[:, 0]).any()


@pytest.mark.parametrize("name", ["pointpillars_v2v4real", "simulated"])
def test_agents_are_served_together_or_one_by_one_with_the_same_bits(name: str) -> None:
    detector, agents = make_detector(name), ("cav_0", "rsu_0", "cav_1")
    assert isinstance(detector, OracleDetector)
    together, apart = (detector.begin(specs(*agents), 3) for _ in range(2))
    rngs, own_rngs = ({agent: np.random.default_rng(k) for k, agent in enumerate(agents)} for _ in range(2))
    views = {agent: view(agent) for agent in agents}
    for frame in range(4):
        oracles = {
            agent: Oracle(actors(5 * k), np.arange(5 * k) * frame, SE3.from_xyz_yaw([9.0 * k, frame, 0.0], 0.3 * k))
            for k, agent in enumerate(agents)
        }
        want = {agent: apart.detect(views[agent], oracles[agent], own_rngs[agent]) for agent in reversed(agents)}
        got = together.detect_all(views, Oracles.of(oracles), rngs)
        assert list(got) == list(agents)
        for agent in agents:
            np.testing.assert_array_equal(got[agent].boxes.array, want[agent].boxes.array)
            np.testing.assert_array_equal(got[agent].score, want[agent].score)
            np.testing.assert_array_equal(got[agent].label, want[agent].label)


def test_errors_last_for_a_time_not_for_a_number_of_sensed_frames() -> None:
    def two_frames(dt_s: float, sense_every: int) -> list[Detections]:
        spec = AgentSpec("cav_0", "cav", dt_s, "none", sense_every=sense_every)
        begun = CorrelatedDetector(preset("pointpillars_v2v4real")).begin({"cav_0": spec}, seed=1)
        oracle = Oracle(actors(30), np.full(30, 100), SE3.identity())
        return [begun.detect(view("cav_0"), oracle, RNG) for _ in range(2)]

    (_, frame), (_, second), (_, tenth) = two_frames(0.1, 1), two_frames(1.0, 1), two_frames(0.1, 10)
    np.testing.assert_array_equal(second.boxes.array, tenth.boxes.array)
    assert not np.isin(frame.boxes.center[:, 0], tenth.boxes.center[:, 0]).any()


def test_angles_stay_wrapped() -> None:
    errors = dict(EXACT.errors) | {"yaw": ErrorModel(flat(1.0))}
    yaw = detect(replace(EXACT, errors=errors), actors(500, yaw=3.1))[0].boxes.yaw
    np.testing.assert_array_equal(yaw, wrap_angle(yaw))


@pytest.mark.parametrize(
    ("make", "match"),
    [
        (lambda: replace(EXACT, reach_x_m=0.0), "reach_x_m must be a finite number > 0"),
        (lambda: replace(EXACT, errors={"along": ErrorModel(flat(0.1))}), "no across"),
        (lambda: replace(EXACT, errors=dict(EXACT.errors) | {"acros": ErrorModel(flat(0.1))}), "unknown error 'acros'"),
        (lambda: DetectionModel(flat(1.2)), r"probability must be in \[0, 1\]"),
        (lambda: Curve((0.0, 0.0), (1.0, 2.0)), "at must rise"),
        (lambda: Curve((0.0,), (1.0, 2.0)), "as many values as places"),
        (lambda: Curve((), ()), "at least one"),
        (lambda: ErrorModel(flat(-0.1)), "spread must be in"),
        (lambda: ScoreModel(1.0, flat(0.0), flat(1.0)), "floor must be in"),
        (lambda: replace(PHANTOMS, density_per_m2=0.02), "density_per_m2 must be in"),
        (lambda: replace(PHANTOMS, size_m=(1.0, 2.0)), "size_m must be length, width and height"),
        (lambda: replace(PHANTOMS, life_s=0.0), "life_s must be a finite number > 0"),
        (lambda: DetectionModel(None), "probability must be a coopsim Curve, got None"),  # type: ignore[arg-type]
        (lambda: replace(EXACT, errors=None), "errors must be a coopsim Mapping"),  # type: ignore[arg-type]
        (lambda: CorrelatedDetector(None), "config must be"),  # type: ignore[arg-type]
    ],
)
def test_bad_input(make, match: str) -> None:  # type: ignore[no-untyped-def]
    with pytest.raises((InvalidValueError, UnknownNameError), match=match):
        make()
