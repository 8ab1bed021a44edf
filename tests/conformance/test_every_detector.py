"""Every registered detector and embedder keeps what environments rely on; the checks find those that do not."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from coopsim.detection.detector import DETECTORS, Detector, NoDetector, SensorNeeds
from coopsim.detection.embedder import EMBEDDERS, Embedder
from coopsim.detection.oracle import Oracle, OracleDetector
from coopsim.detection.simulated.simulated import SimulatedDetector
from coopsim.errors import InvalidValueError, UnknownNameError
from coopsim.geometry.boxes import Boxes3D
from coopsim.testing import check_detector, check_embedder
from coopsim.types import AgentSpec, Detections, SensorView

WITHOUT_WEIGHTS = sorted({*DETECTORS.names()} - {"pillars", "lift_splat", "points_and_pictures"})


@pytest.mark.parametrize("name", [*WITHOUT_WEIGHTS, "simulated(max_recall=0.5)"])
def test_detector(name: str) -> None:
    check_detector(name)


@pytest.mark.parametrize("sweeps", [1, 2])
def test_the_detector_pillars(sweeps: int) -> None:
    pytest.importorskip("torch")
    from tiny_networks import tiny_detector

    check_detector(tiny_detector(sweeps))


@pytest.mark.parametrize(
    "cameras", [pytest.param("surround_6", marks=pytest.mark.long), {"cav_0": "front", "rsu": "front"}]
)
@pytest.mark.parametrize("name", ["lift_splat", "points_and_pictures"])
def test_detectors_with_cameras(name: str, cameras: Any) -> None:
    pytest.importorskip("torch")
    from tiny_networks import tiny_picture_detector

    check_detector(tiny_picture_detector(name), cameras=cameras)


def test_the_embedder_of_points() -> None:
    pytest.importorskip("torch")
    from tiny_networks import tiny_looks

    check_embedder(f"point_identity(weights='{tiny_looks()}')")


def test_the_embedder_of_pictures() -> None:
    pytest.importorskip("torch")
    from tiny_networks import tiny_picture_identity

    check_embedder(f"picture_identity(weights='{tiny_picture_identity()}')")


def one_box(x_m: float = 5.0, width_m: float = 1.9, score: float = 0.5, label: int = 0) -> Detections:
    box = np.array([[x_m, 0.0, 0.8, 4.5, width_m, 1.6, 0.0]])
    return Detections(Boxes3D.from_array(box), np.array([score]), np.array([label]))


class Nearest(Detector):
    """A sound detector: a box over the first point of the first sweep."""

    def detect(self, view: SensorView, rng: np.random.Generator) -> Detections:
        points = next(iter(view.sweeps.values())).points
        return one_box(float(points[0, 0]) + rng.normal()) if len(points) else Detections.empty()


def test_a_class_an_object_or_a_function_is_taken() -> None:
    for detector in (Nearest, Nearest(), lambda: Nearest()):
        check_detector(detector)
    check_detector(Nearest, lidar={"roof": "HDL-32E"}, lidar_columns=64)
    with pytest.raises(UnknownNameError, match=r"unknown detector 'simulatd'. Did you mean 'simulated'"):
        check_detector("simulatd")


class NotDetections(Nearest):
    def detect(self, view: SensorView, rng: np.random.Generator) -> Any:
        return super().detect(view, rng).boxes


class Infinite(Nearest):
    def detect(self, view: SensorView, rng: np.random.Generator) -> Detections:
        return one_box(np.inf)


class Flat(Nearest):
    def detect(self, view: SensorView, rng: np.random.Generator) -> Detections:
        return one_box(width_m=0.0)


class Unsure(Nearest):
    def detect(self, view: SensorView, rng: np.random.Generator) -> Detections:
        return one_box(score=np.nan)


class Classless(Nearest):
    def detect(self, view: SensorView, rng: np.random.Generator) -> Detections:
        return one_box(label=9)


class Unannounced(Nearest):
    def detect(self, view: SensorView, rng: np.random.Generator) -> Detections:
        return replace(one_box(), embedding=np.ones((1, 8)))


class Doubtful(Nearest):
    def detect(self, view: SensorView, rng: np.random.Generator) -> Detections:
        return replace(one_box(), covariance=np.eye(7)[None])


class Absurd(Doubtful):
    states_covariance = True

    def detect(self, view: SensorView, rng: np.random.Generator) -> Detections:
        return replace(one_box(), covariance=-np.eye(7)[None])


class Restless(Nearest):
    def detect(self, view: SensorView, rng: np.random.Generator) -> Detections:
        return one_box(np.random.default_rng().normal())


class Remembering(Nearest):
    """Keeps state across episodes."""

    def __init__(self) -> None:
        self.frames = 0

    def detect(self, view: SensorView, rng: np.random.Generator) -> Detections:
        self.frames += 1
        return one_box(self.frames)


class Sharing(Nearest):
    """Keeps state across agents."""

    def begin(self, specs: Mapping[str, AgentSpec], seed: int) -> Sharing:
        self.asked = 0
        return self

    def detect(self, view: SensorView, rng: np.random.Generator) -> Detections:
        self.asked += 1
        return one_box(self.asked)


class Scribbling(Nearest):
    def detect(self, view: SensorView, rng: np.random.Generator) -> Detections:
        view.sweeps.clear()  # type: ignore[attr-defined]
        return Detections.empty()


class Forgetful(Nearest):
    def detect_all(self, views: Any, rngs: Any) -> dict[str, Detections]:
        return {agent: Detections.empty() for agent in list(views)[1:]}


class NeedsPoints(Nearest):
    def detect(self, view: SensorView, rng: np.random.Generator) -> Detections:
        return one_box(float(view.sweeps["lidar"].points.max()))


@pytest.mark.parametrize(
    ("wrong", "match"),
    [
        (lambda: 3, "must be a Detector or an OracleDetector, got 3"),
        (NotDetections, "NotDetections must return Detections, got Boxes3D"),
        (Infinite, "boxes must be finite"),
        (Flat, "sizes must be > 0"),
        (Unsure, "scores must be finite"),
        (Classless, r"labels must be in 0\.\.8, got \[9\]"),
        (Unannounced, "embeddings must have the length embedding_dim = 0, got 8"),
        (Doubtful, "need states_covariance"),
        (Absurd, "no negative eigenvalue"),
        (Restless, "must give the same again"),
        (Remembering, "must give the same again in a later episode: boxes of cav_0 differ in frame 0"),
        (Sharing, "must not depend on the order of the agents"),
        (Scribbling, "must leave its view as it is"),
        (Forgetful, "detect_all must return the agents"),
    ],
)
def test_a_wrong_detector_is_found(wrong: Callable[[], Any], match: str) -> None:
    with pytest.raises(AssertionError, match=match):
        check_detector(wrong)


def test_a_detector_that_fails_without_points_is_found() -> None:
    with pytest.raises(ValueError, match="zero-size array"):
        check_detector(NeedsPoints)


class Ranges(Embedder):
    """A sound embedder: distance and height."""

    dim = 2

    def embed(self, detections: Detections, view: SensorView) -> Any:
        center = detections.boxes.center
        return np.column_stack([np.linalg.norm(center[:, :2], axis=1), center[:, 2]])


class Sighted(Ranges):
    needs = SensorNeeds(cameras=True)

    def embed(self, detections: Detections, view: SensorView) -> Any:
        return super().embed(detections, view) * view.images["front"].rgb.mean()  # type: ignore[union-attr]


def test_a_sound_embedder_passes() -> None:
    check_embedder(Ranges)
    check_embedder(Ranges())
    check_embedder(Sighted)


class Wide(Ranges):
    dim = 3


class Dimensionless(Ranges):
    dim = 0


class Blank(Ranges):
    def embed(self, detections: Detections, view: SensorView) -> Any:
        return np.zeros((len(detections), 2))


class Dicing(Ranges):
    def embed(self, detections: Detections, view: SensorView) -> Any:
        return np.random.default_rng().normal(size=(len(detections), 2))


class Numbering(Ranges):
    def embed(self, detections: Detections, view: SensorView) -> Any:
        return np.arange(2.0 * len(detections)).reshape(-1, 2) + 1


@pytest.mark.parametrize(
    ("wrong", "match"),
    [
        (lambda: 3, "must be an Embedder, got 3"),
        (Wide, r"Wide.embed must return shape \(\d+, 3\) for \d+ detections, got \(\d+, 2\)"),
        (Dimensionless, "dim must be an integer > 0, got 0"),
        (Blank, "must embed some of the detections"),
        (Dicing, "must give the same embeddings again"),
        (Numbering, "must not depend on the order of the detections"),
    ],
)
def test_a_wrong_embedder_is_found(wrong: Callable[[], Any], match: str) -> None:
    with pytest.raises(AssertionError, match=match):
        check_embedder(wrong)


def test_the_truth_is_given_to_simulated_detectors_alone(make_small: Callable[..., Any]) -> None:
    views: list[SensorView] = []

    class Spy(Nearest):
        def detect(self, view: SensorView, rng: np.random.Generator) -> Detections:
            views.append(view)
            return Detections.empty()

    env = make_small(detector=Spy(), cameras="front", renderer="raycast", expose_ground_truth=True)
    observations, infos = env.reset(seed=1)
    assert [view.agent for view in views] == env.possible_agents
    for view in views:
        assert view.sweeps["lidar"].instance is None and len(infos[view.agent]["instances"]["lidar"])
        np.testing.assert_array_equal(view.sweeps["lidar"].points, observations[view.agent]["sweeps"]["lidar"][:, :3])
        image = view.images["front"]
        assert image.instance is None and image.semantic is None and image.rgb is not None
        assert set(view.cameras) == {"front"} and set(view.lidars) == {"lidar"}
        assert not {"oracle", "actors", "truth"} & set(dir(view))

    class Told(OracleDetector):
        def detect(self, view: SensorView, oracle: Oracle, rng: np.random.Generator) -> Detections:
            truth = infos[view.agent]["ground_truth"]
            np.testing.assert_array_equal(oracle.actors.id, truth["id"])
            np.testing.assert_array_equal(oracle.returns, truth["returns"][:, env.possible_agents.index(view.agent)])
            return Detections(oracle.actors.boxes, np.ones(len(truth["id"])), oracle.actors.label)

    told = make_small(detector=Told())
    observations, _ = told.reset(seed=1)
    for agent, observation in observations.items():
        seen, there = observation["detections"]["box"], infos[agent]["ground_truth"]["box"]
        np.testing.assert_array_equal(seen[np.lexsort(seen.T)], there[np.lexsort(there.T)])  # in no order


def test_all_agents_are_detected_for_in_one_call(make_small: Callable[..., Any]) -> None:
    calls = []

    class Batch(Nearest):
        def detect_all(self, views: Any, rngs: Any) -> dict[str, Detections]:
            calls.append(list(views))
            return dict.fromkeys(views, one_box())

    env = make_small(detector=Batch())
    observations, _ = env.reset(seed=1)
    assert calls == [env.possible_agents]
    assert all(len(observation["detections"]["score"]) == 1 for observation in observations.values())


def test_an_agent_that_is_left_out_is_named(make_small: Callable[..., Any]) -> None:
    with pytest.raises(InvalidValueError, match=r"Forgetful.detect_all must return \['cav_0', .*, got \['cav_1'"):
        make_small(detector=Forgetful()).reset(seed=1)


def test_no_detector_and_an_embedder_by_object_and_name(
    make_small: Callable[..., Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    env = make_small(detector="none")
    observations, _ = env.reset(seed=1)
    assert all(not len(observation["detections"]["score"]) for observation in observations.values())
    monkeypatch.setitem(EMBEDDERS._entries, "ranges", Ranges)
    plain, _ = make_small(detector="simulated").reset(seed=1)
    for embedder in (Ranges(), "ranges"):
        env = make_small(detector="simulated", embedder=embedder)
        observations, _ = env.reset(seed=1)
        for agent, observation in observations.items():
            found = observation["detections"]
            np.testing.assert_array_equal(found["box"], plain[agent]["detections"]["box"])
            assert env.observation_space(agent).contains(observation)
            ratio = found["box"][:, 2] / np.linalg.norm(found["box"][:, :2], axis=1)
            np.testing.assert_allclose(found["embedding"][:, 1] / found["embedding"][:, 0], ratio, rtol=1e-5)
    with pytest.raises(UnknownNameError, match=r"unknown embedder 'rangs'. Did you mean 'ranges'"):
        make_small(embedder="rangs")


@pytest.mark.parametrize(
    ("found", "match"),
    [
        (None, "Returning must return Detections, got NoneType for cav_0"),
        ({}, "Returning must return Detections, got dict for cav_0"),
    ],
)
def test_an_environment_refuses_what_a_detector_must_not_return(
    found: Any, match: str, make_small: Callable[..., Any]
) -> None:
    class Returning(NoDetector):
        def detect(self, view: SensorView, rng: np.random.Generator) -> Detections:
            wrong: Detections = found
            return wrong

    with pytest.raises(InvalidValueError, match=match):
        make_small(detector=Returning()).reset(seed=0)


def test_what_needs_sensors_is_refused_where_there_are_none(make_small: Callable[..., Any]) -> None:
    class Camera(NoDetector):
        needs = SensorNeeds(cameras=True)

    cases = [
        (
            {"lidar": None, "detector": Nearest()},
            "^detector must need no sweeps where lidar is None, got Nearest",
        ),
        ({"detector": Camera()}, "^detector must need no images where cameras is False"),
        ({"embedder": Sighted()}, "^embedder must need no images where cameras is False"),
    ]
    for options, match in cases:
        with pytest.raises(InvalidValueError, match=match):
            make_small(**options)
    make_small(lidar=None, detector=SimulatedDetector())
    make_small(detector=Camera(), cameras="front")
