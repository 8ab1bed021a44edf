"""Learned covariances in policies: of every box, in the right frame, for any tracker; wrong weights are refused."""

from __future__ import annotations

from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import pytest
import torch
from synthetic_recordings import write_recordings

import coopsim
from coopsim.agents.learned_covariance import LearnedCovariance
from coopsim.comms.codecs.codec import CODECS
from coopsim.comms.uplinks.uplink import ContentUplink
from coopsim.errors import CoopsimError
from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.se3 import SE3, SE3Batch
from coopsim.learn.weights import load_covariance, make_network, save_weights
from coopsim.tracking.motion.constant_velocity import ConstantVelocity
from coopsim.types import AgentSpec, Detections
from coopsim.types.groups import DetectionGroups

KNOWN = np.array([True, True])


@pytest.fixture(scope="module")
def weights(tmp_path_factory: pytest.TempPathFactory) -> str:
    net = make_network("covariance", {"codes": 4, "widths": [8]})
    assert net.last is not None
    torch.nn.init.normal_(net.last.weight, std=2.0, generator=torch.Generator().manual_seed(0))
    path = tmp_path_factory.mktemp("weights") / "mine.safetensors"
    save_weights(path, net, {"kind": "covariance", "config": asdict(net.config)})
    return str(path)


def boxes(*xy: tuple[float, float]) -> Detections:
    rows = np.array([[x, y, 0.8, 4.5, 1.9, 1.6, 0.3] for x, y in xy])
    return Detections(Boxes3D.from_array(rows), np.full(len(rows), 0.8), np.zeros(len(rows), dtype=int))


def applied(learned: LearnedCovariance, base: SE3, *groups: Detections, sender: SE3, known: np.ndarray) -> np.ndarray:
    """Covariances in the receiver's base frame of groups in that frame."""
    moved = DetectionGroups.of([each.transform(base) for each in groups])
    sensors = SE3Batch.of([base, base.compose(sender)])
    found = learned.apply(moved, base, sensors, known)
    np.testing.assert_array_equal(found.joined.boxes.array, moved.joined.boxes.array)
    covariance = found.joined.transform(base.inverse()).covariance
    assert covariance is not None
    return covariance


def test_covariances_are_diagonal_in_the_receivers_frame_wherever_it_is(weights: str) -> None:
    learned, sender = LearnedCovariance(weights), SE3.from_xyz_yaw([20, 5, 0], 2.0)
    groups = boxes((10, 2), (-5, 30)), boxes((11, 2))
    here = applied(learned, SE3.identity(), *groups, sender=sender, known=KNOWN)
    there = applied(learned, SE3.from_xyz_yaw([300, -40, 2], 0.7), *groups, sender=sender, known=KNOWN)
    np.testing.assert_allclose(here, there, rtol=1e-4, atol=1e-5)
    assert np.abs(here * (1 - np.eye(7))).max() < 1e-9
    assert (np.diagonal(here, axis1=1, axis2=2) > 0).all()


def test_it_matters_where_the_sender_is_unless_that_is_not_known(weights: str) -> None:
    learned, groups = LearnedCovariance(weights), (boxes((10, 2)), boxes((11, 2)))
    near, far = (SE3.from_xyz_yaw([x, 0, 0], 0.0) for x in (5, 90))
    a, b = (applied(learned, SE3.identity(), *groups, sender=each, known=KNOWN) for each in (near, far))
    assert np.abs(a[1] - b[1]).max() > 1e-3
    np.testing.assert_allclose(a[0], b[0], rtol=1e-5)
    first = np.array([True, False])
    a, b = (applied(learned, SE3.identity(), *groups, sender=each, known=first) for each in (near, far))
    np.testing.assert_array_equal(a, b)


def test_what_detectors_state_is_replaced(weights: str) -> None:
    learned, base = LearnedCovariance(weights), SE3.identity()
    plain = boxes((10, 2))
    stated = replace(plain, covariance=np.eye(7)[None])
    sensors = SE3Batch.of([base, base])
    mixed = learned.apply(DetectionGroups.of([stated, plain]), base, sensors, KNOWN)
    alike = learned.apply(DetectionGroups.of([plain, plain]), base, sensors, KNOWN)
    assert mixed.joined.covariance is not None and alike.joined.covariance is not None
    np.testing.assert_allclose(mixed.joined.covariance, alike.joined.covariance)
    none = DetectionGroups.of([plain[:0], plain[:0]])
    assert learned.apply(none, base, sensors, KNOWN) is none


@pytest.mark.parametrize("policy", ["no_fusion", "sequential_kf", "late_fusion", "coop_fuse", "dino_codt_tracking"])
def test_any_tracker_can_have_them(policy: str, weights: str, tmp_path: Path) -> None:
    recordings, detections = write_recordings(tmp_path, ("0001",)), ("ego", "1")
    without = coopsim.evaluate_recordings(coopsim.make_policy(policy), recordings, detections)
    learned = coopsim.evaluate_recordings(coopsim.make_policy(policy, covariance=weights), recordings, detections)
    assert learned.count["TP"] > 0
    assert learned.count["AMOTP"] != without.count["AMOTP"]


def test_without_weights_dmstrack_is_the_filter_with_fixed_noise(weights: str) -> None:
    fixed = coopsim.make_policy("dmstrack", covariance=None).make_tracker()  # type: ignore[attr-defined]
    assert fixed.motion == ConstantVelocity()
    learned = coopsim.make_policy("dmstrack", covariance=weights).make_tracker()  # type: ignore[attr-defined]
    assert learned.motion == load_covariance(weights).motion()


@pytest.mark.parametrize(
    ("given", "match"),
    [
        ("nobodys", "unknown weights 'nobodys'"),
        (3, "covariance must be the name or path of weights, got 3"),
        ("pillars", "must be weights of the kind 'covariance', is 'detector'"),
        ("missing.safetensors", "cannot read missing.safetensors"),
    ],
)
def test_wrong_weights_are_refused(given: object, match: str) -> None:
    with pytest.raises(CoopsimError, match=match):
        coopsim.make_policy("sequential_kf", covariance=given)


def test_the_shipped_covariances_that_see_features_are_for_the_shipped_detector() -> None:
    from coopsim.learn.weights import load_detector

    net = load_covariance("dmstrack_seen", load_detector("pillars"))
    assert net.config.features == load_detector("pillars").config.features
    with pytest.raises(CoopsimError, match="encoder"):
        load_covariance("dmstrack_seen", load_detector("early"))


@pytest.mark.parametrize(
    ("given", "asked", "codec"),
    [
        ("dmstrack_seen", None, "compact"),
        ("dmstrack_seen", "detections", "detections"),
        ("dmstrack", None, "detections"),
    ],
)
def test_covariances_that_detectors_state_are_sent_unless_another_codec_is_asked_for(
    given: str, asked: str | None, codec: str
) -> None:
    policy = coopsim.make_policy("dmstrack", covariance=given)
    spec = AgentSpec("cav_0", "cav", 0.1, "detections", codec=asked)
    uplink = policy.make_uplink(spec, np.random.default_rng(0))
    assert isinstance(uplink, ContentUplink)
    assert isinstance(uplink.codec, CODECS.get(codec))
