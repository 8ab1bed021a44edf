"""Samples and policies in OpenCOOD's layout: voxels hold their points, transforms place them, boxes are around them."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("torch")

import torch
from tiny_recordings import WORLD_SE3_BASES, boxes, write_opv2v
from torch.utils.data import DataLoader

import coopsim
from coopsim.agents.opencood_network import OpenCoodNetwork
from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.se3 import SE3
from coopsim.learn.opencood import Layout, collate, make_sample, voxelize
from coopsim.learn.opencood_frames import CooperativeFrames, join
from coopsim.testing import check_policy
from coopsim.types import PointCloud

RNG = np.random.default_rng(0)
SMALL = Layout(range_m=(-20, -20, -3, 20, 20, 1), most_points=4, most_voxels=60)
HERE, THERE = SE3.from_xyz_yaw([0, 0, 0], 0.0), SE3.from_xyz_yaw([10, 4, 0.5], 0.7)


def cloud(count: int = 500, reach_m: float = 18.0) -> PointCloud:
    return PointCloud(RNG.uniform(-reach_m, reach_m, (count, 3)) * [1, 1, 0.1] + [0, 0, 1], RNG.random(count))


def test_voxels_hold_the_points_of_their_cells_in_order() -> None:
    points = cloud().transform(SMALL.lidar_SE3_base)
    made = voxelize(SMALL, points)
    low, size = np.array(SMALL.range_m[:3]), np.array(SMALL.voxel_m)
    seen: dict[tuple[int, ...], list[Any]] = {}
    for xyz, intensity in zip(points.xyz, points.intensity, strict=True):
        cell = tuple(np.floor((xyz - low) / size).astype(int)[::-1])
        seen.setdefault(cell, []).append([*xyz, intensity])
    cells = list(seen)[: SMALL.most_voxels]
    assert [tuple(row[1:]) for row in made["voxel_coords"]] == cells
    for number, cell in enumerate(cells):
        kept = np.array(seen[cell][: SMALL.most_points])
        assert made["voxel_num_points"][number] == len(kept)
        np.testing.assert_allclose(made["voxel_features"][number, : len(kept)], kept, rtol=1e-6)
        assert not made["voxel_features"][number, len(kept) :].any()


def test_points_outside_and_no_points_at_all_make_no_voxels() -> None:
    far = PointCloud(np.array([[500.0, 0, 0]]), np.ones(1))
    for empty in (PointCloud.empty(), far):
        assert [len(value) for value in voxelize(SMALL, empty).values()] == [0, 0, 0]


def test_a_matrix_takes_points_from_one_agents_frame_to_the_others() -> None:
    sample = make_sample(SMALL, [cloud(), cloud()], [HERE, THERE])
    point = np.array([3.0, -2.0, 0.0])
    of_second = sample["pairwise_t_matrix"][0, 1, 0] @ [*point, 1]
    expected = THERE.apply(point + np.array([0, 0, SMALL.origin_z_m])) - np.array([0, 0, SMALL.origin_z_m])
    np.testing.assert_allclose(of_second[:3], expected)
    back = sample["pairwise_t_matrix"][0, 0, 1] @ of_second
    np.testing.assert_allclose(back[:3], point, atol=1e-12)
    assert sample["record_len"].tolist() == [2]
    assert (sample["pairwise_t_matrix"][0, 2:] == np.eye(4)).all()


def test_projected_points_are_in_the_receivers_frame_and_matrices_say_so() -> None:
    layout = Layout(range_m=SMALL.range_m, projected=True)
    one = PointCloud(np.array([[1.0, 2.0, 1.0]]), np.ones(1))
    sample = make_sample(layout, [PointCloud.empty(), one], [HERE, THERE])
    found = sample["processed_lidar"]["voxel_features"][0, 0, :3]
    np.testing.assert_allclose(found, THERE.apply(one.xyz[0]) - [0, 0, layout.origin_z_m], rtol=1e-5)
    assert (sample["pairwise_t_matrix"] == np.eye(4)).all() and sample["processed_lidar"]["voxel_coords"][0, 0] == 1


def test_the_nearest_agents_are_kept_and_the_receiver_is_first() -> None:
    poses = [HERE, *(SE3.from_xyz_yaw([x, 0, 0], 0.0) for x in (30.0, 10.0, 20.0))]
    marked = [PointCloud(np.array([[0.0, 0, 1]]), np.array([level])) for level in (0.1, 0.3, 0.5, 0.7)]
    sample = make_sample(Layout(most_agents=3), marked, poses)
    assert sample["record_len"].tolist() == [3]
    np.testing.assert_allclose(sample["processed_lidar"]["voxel_features"][:, 0, 3], [0.1, 0.5, 0.7])


@pytest.mark.parametrize(("order", "sizes"), [("hwl", [1.5, 1.9, 4.5]), ("lwh", [4.5, 1.9, 1.5])])
def test_boxes_come_back_from_rows_of_either_order(order: str, sizes: list[float]) -> None:
    layout = Layout(order=order)
    boxes = Boxes3D.from_array([[5.0, 2.0, 0.8, 4.5, 1.9, 1.5, 0.3]])
    rows = layout.to_rows(boxes)
    np.testing.assert_allclose(rows[0], [5.0, 2.0, 0.8 - layout.origin_z_m, *sizes, 0.3])
    np.testing.assert_allclose(layout.to_boxes(rows).array, boxes.array)


def test_a_batch_counts_agents_through_its_samples() -> None:
    two, one = make_sample(SMALL, [cloud(), cloud()], [HERE, THERE]), make_sample(SMALL, [cloud()], [HERE])
    batch = collate([two, one])
    assert batch["record_len"].tolist() == [2, 1]
    assert np.unique(batch["processed_lidar"]["voxel_coords"][:, 0]).tolist() == [0, 1, 2]
    assert batch["pairwise_t_matrix"].shape == (2, 5, 5, 4, 4) and batch["object_ids"] == [[], []]


@pytest.mark.parametrize("wrong", [{"order": "wlh"}, {"most_agents": 0}, {"voxel_m": (0, 1, 1)}, {"range_m": (1, 2)}])
def test_a_wrong_layout_is_refused(wrong: dict[str, Any]) -> None:
    with pytest.raises(coopsim.CoopsimError):
        Layout(**wrong)


SIMPLE = {"lidar": "VLP-16", "vehicles": 8, "pedestrians": 0, "max_cycles": 2}


def test_a_loader_gives_batches_with_points_in_the_boxes() -> None:
    frames = CooperativeFrames("crossing", (0, 1), **SIMPLE)
    (first, *_), inside = list(DataLoader(frames, batch_size=2, collate_fn=join)), 0
    assert first["object_bbx_mask"].sum() > 0 and first["record_len"].shape == (2,)
    voxels = first["processed_lidar"]
    own = voxels["voxel_features"][voxels["voxel_coords"][:, 0] == 0].reshape(-1, 4)[:, :3].numpy()
    known = first["object_bbx_mask"][0].bool()
    assert known.sum() == len(first["object_ids"][0])
    for x, y, z, high, wide, long, yaw in first["object_bbx_center"][0][known].numpy():
        turned = (own[:, :2] - [x, y]) @ [[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]]
        over = np.abs(own[:, 2] - z) < high / 2
        inside += int(((np.abs(turned) < [long / 2, wide / 2]).all(axis=1) & over).sum())
    assert inside > 50


def test_recordings_give_a_sample_for_each_car_and_frame(tmp_path: Path) -> None:
    """The other car's points are placed by the poses of the files, and the labels are in the receiver's frame."""
    frames = CooperativeFrames(write_opv2v(tmp_path) / "train", max_cycles=2)
    samples = list(frames)
    assert len(samples) >= 4 and len(samples) % 2 == 0
    assert all(int(sample["record_len"]) == 2 for sample in samples)
    first, z_m = samples[0], Layout().origin_z_m
    own = boxes(0).center @ WORLD_SE3_BASES[0].rotation + WORLD_SE3_BASES[0].inverse().translation
    found = first["object_bbx_center"][first["object_bbx_mask"].bool()].numpy()
    gaps = np.linalg.norm(own[:, None, :2] - found[None, :, :2], axis=2)
    assert len(found) and gaps.min(axis=0).max() < 0.1
    into_first = WORLD_SE3_BASES[0].inverse().compose(WORLD_SE3_BASES[1])
    matrix = first["pairwise_t_matrix"].reshape(5, 5, 4, 4)[1, 0].numpy()
    np.testing.assert_allclose(matrix[:3, 3], into_first.apply(np.array([0, 0, z_m])) - [0, 0, z_m], atol=0.05)


def test_recordings_and_the_simulator_give_the_same_keys(tmp_path: Path) -> None:
    recorded = next(iter(CooperativeFrames(write_opv2v(tmp_path) / "train", max_cycles=1)))
    simulated = next(iter(CooperativeFrames("crossing", **SIMPLE)))
    assert recorded.keys() == simulated.keys()
    assert recorded["processed_lidar"].keys() == simulated["processed_lidar"].keys()


def test_workers_share_the_episodes() -> None:
    frames = CooperativeFrames("crossing", (0, 1), **SIMPLE)
    alone = sum(1 for _ in frames)
    assert sum(1 for _ in DataLoader(frames, batch_size=None, num_workers=2)) == alone


@dataclass(kw_only=True, eq=False)
class Middle(OpenCoodNetwork):
    """Reports a box on the fullest voxel of the receiver, and remembers its batches."""

    def __post_init__(self) -> None:
        self.met: list[dict[str, Any]] = []
        super().__post_init__()

    def forward(self, batch: dict[str, Any]) -> tuple[torch.Tensor, torch.Tensor]:
        self.met = [*self.met[-8:], batch]
        row = torch.tensor([[8.0, 0, -1, 1.5, 1.9, 4.5, 0]])
        return row[: int(len(batch["processed_lidar"]["voxel_coords"]) > 0)], torch.ones(1)[: len(row)]


def test_a_network_gets_the_points_of_all_agents() -> None:
    policy = Middle(hits=1)
    result = coopsim.evaluate(policy, "crossing", seed=0, **SIMPLE)
    assert max(int(batch["record_len"]) for batch in policy.met) > 1
    assert set(policy.met[-1]) >= {"processed_lidar", "record_len", "pairwise_t_matrix"}
    assert result.messages.rejected == 0 and result.score["bytes_per_s"] > 10_000


def test_such_a_policy_conforms() -> None:
    check_policy(Middle, lidar="VLP-16")
