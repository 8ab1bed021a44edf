"""DINO-CoDT with an embedder: who describes what, what is sent, and what happens where nothing can be described."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

pytest.importorskip("torch")

from tiny_networks import learned, tiny_picture_identity

import coopsim
from coopsim.bench.evaluate import Evaluation
from coopsim.errors import PolicyMismatchError, UnknownNameError
from coopsim.geometry.boxes import Boxes3D
from coopsim.sensors.camera.camera import Camera
from coopsim.sensors.camera.intrinsics import Intrinsics
from coopsim.testing import check_policy
from coopsim.types import Detections

WITH, WITHOUT = "boxes tracked with an embedding", "boxes tracked by geometry alone"
LENS = Intrinsics.from_fov(160, 90, np.radians(100.0))
CAMERAS = [Camera("ahead", LENS), Camera("behind", LENS, yaw_rad=np.pi)]
SMALL: dict[str, Any] = {"vehicles": 10, "max_cycles": 4, "lidar": None, "renderer": "raycast", "seed": 1}


def looking(**settings: Any) -> coopsim.Policy:
    spec = f"picture_identity(weights='{tiny_picture_identity()}', least_area_px=8)"
    return coopsim.make_policy("dino_codt_tracking", embedder=spec, **settings)


def play(policy: coopsim.Policy | str, **options: Any) -> Evaluation:
    return coopsim.evaluate(policy, **SMALL | options)


def test_each_agent_describes_what_it_detects_and_sends_it_along() -> None:
    blind, seeing = play("dino_codt_tracking", cameras=CAMERAS), play(looking(), cameras=CAMERAS)
    assert seeing.counts[WITH] > 0 and blind.counts[WITH] == 0 < blind.counts[WITHOUT]
    assert seeing.score["bytes_per_s"] > blind.score["bytes_per_s"] + 20
    given = play("dino_codt_tracking", cameras=CAMERAS, embedder=looking().embedder)  # type: ignore[attr-defined]
    assert given.counts == seeing.counts, "the environment's embedder or the policy's: the same"


def test_cameras_are_drawn_for_who_asks() -> None:
    assert looking().needs.cameras == "surround" and not coopsim.make_policy("dino_codt_tracking").needs.cameras
    assert play(looking(), max_cycles=1).counts[WITH] > 0


def test_agents_without_cameras_take_part_by_boxes() -> None:
    some = play(looking(), cameras={"cav": CAMERAS}, rsus=1, connected_cars=2)
    assert some.counts[WITH] > 0 and some.counts[WITHOUT] > 0
    none, plain = play(looking(), cameras=False), play("dino_codt_tracking", cameras=False)
    assert none.counts[WITH] == 0 and none.counts == plain.counts
    assert none.score.values == plain.score.values


def test_embeddings_of_another_length_are_no_embeddings() -> None:
    policy = coopsim.make_policy("dino_codt_tracking")
    boxes = Boxes3D.from_array(np.array([[8.0 * k, 0, 0.8, 4, 2, 1.5, 0] for k in range(2)]))

    def found(away_m: float, dim: int) -> Detections:
        at = Boxes3D(boxes.center + away_m * np.eye(3)[1], boxes.size, boxes.yaw)
        return Detections(at, np.full(2, 0.9), np.zeros(2, int), embedding=np.ones((2, dim)))

    policy.fuse([found(0, 6), found(20, 9)])  # type: ignore[attr-defined]
    assert policy.counts == {WITH: 2, WITHOUT: 2}


def test_the_policy_keeps_what_environments_rely_on() -> None:
    check_policy(looking, cameras=CAMERAS, renderer="raycast", max_cycles=3, vehicles=6)


@pytest.mark.parametrize("sensors", ["both", "points"])
def test_the_whole_method_describes_what_it_finds_in_fused_maps(sensors: str) -> None:
    embedder = f"picture_identity(weights='{tiny_picture_identity()}', least_area_px=8)"
    options: dict[str, Any] = {"lidar": "VLP-16", "lidar_columns": 256, "detector": "none", "cameras": CAMERAS}
    settings = learned("dino_codt", sensors=sensors, least_score=0.05)
    seeing = play(coopsim.make_policy("dino_codt", embedder=embedder, **settings), **options)
    plain = play(coopsim.make_policy("dino_codt", **settings), **options)
    assert seeing.counts[WITH] > 0 and plain.counts[WITH] == 0
    assert sum(seeing.counts.values()) == sum(plain.counts.values())
    with pytest.raises(PolicyMismatchError, match="needs cameras"):
        play(coopsim.make_policy("dino_codt", embedder=embedder, **settings), **options | {"cameras": False})


def test_an_unknown_embedder_is_refused() -> None:
    with pytest.raises(UnknownNameError, match="unknown embedder 'picture'"):
        coopsim.make_policy("dino_codt_tracking", embedder="picture")
