"""Networks on another device: all agents in one batch, everything on it, and the same results."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

torch = pytest.importorskip("torch")

from fake_gpu import FakeGpu  # noqa: E402
from lit_pictures import lit_view  # noqa: E402
from representatives import all_of  # noqa: E402
from street_scene import spec_of, sweep_from, view_of  # noqa: E402
from tiny_networks import learned, tiny_detector, tiny_picture_detector  # noqa: E402

import coopsim  # noqa: E402
from coopsim.catalog import policies_on_boxes  # noqa: E402
from coopsim.detection.presets import make_detector  # noqa: E402
from coopsim.errors import InvalidValueError  # noqa: E402

NAMES = sorted({*coopsim.POLICIES.names()} - {*policies_on_boxes(), "truth", "yoloo"})
FAMILIES = ("cooptrack", "dino_codt", "early", "ff_tracking", "univ2x", "vic_integrated", "where2comm")
"""One policy of each kind of message and of tracking. The other maps differ by their fusion alone."""
SMALL: dict[str, Any] = {"vehicles": 8, "lidar": "VLP-16", "lidar_columns": 256, "max_cycles": 2, "latency_s": 0.1}
VIEWS = [
    replace(lit_view(light), sweeps=view_of(sweep_from((0, 0, 0, 0), [light])).sweeps)
    for light in ((14.4, -7.2), (-9.6, 12.0), (0.0, 16.8))
]


@pytest.fixture(autouse=True)
def float32(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COOPSIM_PRECISION", "float32")


def found_by(name: str, **settings: Any) -> list[Any]:
    """What each agent detects in each frame of an episode: boxes and scores in one array."""
    policy: Any = coopsim.make_policy(name, **learned(name, least_score=0.3, **settings))
    env = coopsim.parallel_env("crossing", uplink=policy, detector="none", **SMALL)
    observations, _ = env.reset(seed=3)
    policy.reset(env.agent_specs, seed=3)
    found: list[Any] = []
    while env.agents:
        actions = policy.act(observations)
        for agent in sorted(actions):
            each = policy.detections(agent)
            found.append(np.column_stack([each.boxes.array, each.score]))
        observations, *_ = env.step(actions)
    assert len(env.agent_specs) > 1 and sum(map(len, found)) > 10
    return found


@pytest.mark.parametrize("name", all_of(NAMES, *FAMILIES))
def test_a_policy_on_a_gpu_has_everything_there_and_finds_the_same(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """One batch for all agents, there; here, one agent after another."""
    alone = found_by(name)
    with FakeGpu(monkeypatch) as gpu:
        there = found_by(name, device="cuda")
    assert gpu.layers and not gpu.elsewhere
    for one, other in zip(alone, there, strict=True):
        np.testing.assert_allclose(one, other, atol=1e-3)


@pytest.mark.parametrize("sensors", ["both", "mixed"])
def test_a_policy_with_cameras_on_a_gpu(sensors: str, monkeypatch: pytest.MonkeyPatch) -> None:
    def maps(device: str) -> list[Any]:
        policy: Any = coopsim.make_policy("fcooper", **learned("fcooper", sensors=sensors, device=device))
        lidar = replace(VIEWS[1], agent="rsu_1", lidars=spec_of("cav_0").lidars)
        return [each.message.values for each in policy._encode.all([VIEWS[0], lidar]).values()]

    alone = maps("cpu")
    with FakeGpu(monkeypatch) as gpu:
        there = maps("cuda:0")
    assert gpu.layers and not gpu.elsewhere
    np.testing.assert_allclose(there, alone, atol=1e-4)


# Named by hand: a folder made anew in each process would be part of the ids, and processes must collect the same ones.
@pytest.mark.parametrize(
    "spec",
    [tiny_detector(), *map(tiny_picture_detector, ("lift_splat", "points_and_pictures"))],
    ids=["pillars", "lift_splat", "points_and_pictures"],
)
def test_a_detector_on_a_gpu_has_everything_there_and_finds_the_same(
    spec: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    def found(device: str) -> list[Any]:
        detector = make_detector(f"{spec[:-1]}, device='{device}')").begin({}, 0)
        views = {name: replace(view, agent=name) for name, view in zip("abc", VIEWS, strict=True)}
        detected = detector.detect_all(views, {name: np.random.default_rng(0) for name in views})
        return [np.column_stack([each.boxes.array, each.score]) for each in detected.values()]

    alone = found("cpu")
    assert sum(map(len, alone))
    with FakeGpu(monkeypatch) as gpu:
        there = found("auto")
    assert gpu.layers and not gpu.elsewhere
    for one, other in zip(alone, there, strict=True):
        np.testing.assert_allclose(one, other, atol=1e-3)


def test_a_forgotten_tensor_is_noticed(monkeypatch: pytest.MonkeyPatch) -> None:
    policy: Any = coopsim.make_policy("cooptrack", **learned("cooptrack"))
    with FakeGpu(monkeypatch) as gpu:
        layer = torch.nn.Linear(2, 2)
        layer(torch.ones(1, 2))
        assert gpu.elsewhere == ["linear"]
        with pytest.raises(RuntimeError, match="to be on the same device"):
            layer.to("cuda:0")(torch.ones(1, 2))
        with pytest.raises(TypeError, match="can't convert"):
            (torch.ones(2, device=torch.device("cuda")) + 1).numpy()
    with pytest.raises(InvalidValueError, match=r"device must be auto or one that is here .* got 'cuda:9'"):
        type(policy)(**learned("cooptrack", device="cuda:9"))
