"""What a policy fuses is what its network was trained on: one scene, cut as a sample and driven through the policy."""

from __future__ import annotations

import sys
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

torch = pytest.importorskip("torch")

from street_scene import spec_of  # noqa: E402
from tiny_networks import TINY, make_it_see  # noqa: E402

import coopsim  # noqa: E402
from coopsim.learn.losses.fused_losses import SentMaps, fused_features  # noqa: E402
from coopsim.learn.samples.cloud_samples import SampleSettings  # noqa: E402
from coopsim.learn.samples.fused_samples import SceneDraft  # noqa: E402
from coopsim.learn.samples.sample_frames import rotated  # noqa: E402
from coopsim.learn.weights import (  # noqa: E402
    encoder_digest,
    load_cooperative,
    load_detector,
    make_network,
    save_weights,
)
from coopsim.support.precision import arithmetic  # noqa: E402
from coopsim.types import Detections, Observation, Odometry, PoseEstimate, Sweep  # noqa: E402

sys.path.append(str(Path(__file__).parents[1] / "unit" / "learn" / "samples"))
from test_cloud_samples import clip  # noqa: E402

NAMES = ("cav_0", "cav_1", "cav_2")


def weights(folder: Path) -> tuple[Path, Path]:
    detector = make_network("detector", TINY | {"cell_m": 0.6})
    make_it_see(detector)
    save_weights(folder / "pillars.safetensors", detector, {"kind": "detector", "config": asdict(detector.config)})
    known = encoder_digest(load_detector(folder / "pillars.safetensors"))
    net = make_network("cooperative", {"fusion": "where2comm", "message_channels": 3, "features": 8})
    said = {"kind": "cooperative", "config": asdict(net.config), "encoder_digest": known}
    save_weights(folder / "where2comm.safetensors", net, said)
    return folder / "pillars.safetensors", folder / "where2comm.safetensors"


def observation(draft: Any, number: int) -> Observation:
    """What an agent observes in a world whose x axis is that of the sample's maps."""
    row = draft.rows[draft.number, number]
    agent, frame = draft.clip.scenes[draft.number].agents[number], draft.frames[row]
    way_m = rotated((frame[:2] - agent.xyz_yaw[:2])[None], -frame[3])[0]  # from where it believes to be to the middle
    pose = np.array([*(draft.middles[row] - way_m), agent.xyz_yaw[2], agent.xyz_yaw[3] - frame[3]])
    cloud = agent.points
    sweep = Sweep(cloud[:, :3].copy(), cloud[:, 3].copy(), np.zeros(len(cloud), np.int64))
    return Observation(0, PoseEstimate(pose), Odometry(np.zeros(4)), Detections.empty(), {"lidar": sweep}, inbox=())


def trained_on(draft: Any, detector: Any, net: Any) -> tuple[Any, Any, Any]:
    """The first receiver's fused features in a training, their grid, and where senders a cell aside would be seen."""
    sample = draft.sample()
    with torch.no_grad(), torch.autocast("cpu", torch.bfloat16, enabled=arithmetic() == "bfloat16"):
        features = detector.encoder(sample.pillars)
        maps = SentMaps(features, *net.message(features), sample.grid)
        fused, _ = fused_features(net, maps, sample.views[0])
        astray = replace(sample.views[0], source_SE2_target=sample.views[0].source_SE2_target + np.array([1.2, 0, 0]))
        moved, _ = fused_features(net, maps, astray)
    return fused[0], sample.views[0].grid, ((fused - moved).abs() > 0.01 * fused.amax())[0]


def used(draft: Any, files: tuple[Path, Path], monkeypatch: pytest.MonkeyPatch) -> tuple[Any, Any]:
    """The same by the policy, from points and messages."""
    paths = {"detector_weights": str(files[0]), "weights": str(files[1])}
    policy: Any = coopsim.make_policy("where2comm", region_m=(48.0, 48.0), **paths)
    specs = {name: replace(spec_of(name), codec="features(number=float32)") for name in NAMES}
    policy.reset(specs)
    uplink, seen = policy.make_uplink(specs["cav_0"], np.random.default_rng(0)), []
    for spec in specs.values():
        uplink.begin(spec, np.random.default_rng(0))
    inbox = tuple(uplink.message(name, observation(draft, k)) for k, name in enumerate(NAMES) if k)
    fuse = policy._perceiver.fuse
    monkeypatch.setattr(policy._perceiver, "fuse", lambda *args: seen.append((fuse(*args), args[1])) or seen[-1][0])
    policy.track("cav_0", replace(observation(draft, 0), inbox=inbox))
    return seen[-1]


@pytest.mark.parametrize(("seed", "precision"), [(1, "float32"), (2, "float32"), (1, "bfloat16")])
def test_a_policy_fuses_what_its_network_was_trained_on(
    seed: int, precision: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COOPSIM_PRECISION", precision)
    torch.set_num_threads(1)
    files = weights(tmp_path)
    settings = SampleSettings(noise_m=1.0, noise_deg=4.0, mirrored=0.0, thinned=0.0, dropout=0.0, late=0.0)
    draft = SceneDraft(clip(3), 1, [0, 1, 2], np.random.default_rng(seed), settings)
    expected, view, telling = trained_on(draft, load_detector(files[0]), load_cooperative(files[1]))
    found, region = used(draft, files, monkeypatch)
    x_m, y_m = draft.middles[0] - observation(draft, 0).pose.xyz_yaw[:2]  # of the sample's frame, seen from the agent
    start = np.subtract([view.y_m[0] + y_m, view.x_m[0] + x_m], [region.y_m[0], region.x_m[0]]) / 1.2
    np.testing.assert_allclose(start, np.round(start), atol=1e-6)
    start = np.round(start).astype(int)
    first, last = np.maximum(start, 0), np.minimum(start + expected.shape[1:], found.shape[1:])
    assert ((last - first) >= 20).all()
    (i, j), (a, b) = first, first - start
    rows, columns = last - first
    (expected, telling), found = (
        [each[:, a : a + rows, b : b + columns] for each in (expected, telling)],
        found[:, i : i + rows, j : j + columns],
    )
    assert expected.amax() > 0.1
    near = torch.isclose(found.float(), expected.float(), atol=0.01 * float(expected.amax()))
    assert near.float().mean() > 0.999  # a point on the edge of two pillars may be rounded to either
    assert telling.sum() > 20 and near[telling].float().mean() > 0.95
