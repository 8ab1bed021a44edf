"""Frames of several agents in the layout that networks of OpenCOOD's kind take, as arrays.

| key | shape | content |
|---|---|---|
| processed_lidar | a dict: | |
| - voxel_features | (V, P, 4) | x, y, z, intensity of points; zeros after the last |
| - voxel_coords | (V, 4) | agent, z, y, x |
| - voxel_num_points | (V,) | points of each voxel |
| record_len | (B,) | agents of each sample |
| pairwise_t_matrix | (B, L, L, 4, 4) | of agents i, j: from the frame of i to that of j |
| object_bbx_center | (B, M, 7) | x, y, z of the middle, sizes in the layout's order, yaw; zeros after the last |
| object_bbx_mask | (B, M) | 1 where there is an object |
| object_ids | list of B lists | ids of the objects |

The first agent of a sample is the receiver, and boxes are in its frame: x forward, y left, z up, the origin
`origin_z_m` above the ground, where LiDARs are. Names and shapes are those of OpenCOOD's batches (Xu et al.,
"OPV2V", ICRA 2022), written anew: its licence forbids to take code.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from coopsim.errors import InvalidValueError
from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.se3 import SE3, Floats
from coopsim.support.checks import require_choice, require_count, require_flag
from coopsim.types import PointCloud

Batch = dict[str, Any]

_ORDERS: Mapping[str, list[int]] = {"hwl": [5, 4, 3], "lwh": [3, 4, 5]}
"""Columns of a box's sizes, by order."""


@dataclass(frozen=True, slots=True)
class Layout:
    """Choices of a network of OpenCOOD's kind; the defaults are those of PointPillars on OPV2V.

    Attributes:
        range_m: smallest x, y, z and largest x, y, z of voxels, m.
        voxel_m: size of a voxel, m.
        most_points: points of a voxel; further ones are left out.
        most_voxels: voxels of an agent; further ones are left out.
        most_agents: agents of a sample, L; the farthest are left out.
        most_objects: rows of boxes, M; further objects are left out.
        order: order of a box's sizes, "hwl" or "lwh".
        projected: points are moved to the receiver's frame before they become voxels, and matrices are the identity.
        origin_z_m: height of the frames' origin over the ground, m.
    """

    range_m: tuple[float, ...] = (-140.8, -40.0, -3.0, 140.8, 40.0, 1.0)
    voxel_m: tuple[float, ...] = (0.4, 0.4, 4.0)
    most_points: int = 32
    most_voxels: int = 70_000
    most_agents: int = 5
    most_objects: int = 100
    order: str = "hwl"
    projected: bool = False
    origin_z_m: float = 1.9

    def __post_init__(self) -> None:
        if len(self.range_m) != 6 or len(self.voxel_m) != 3 or not min(self.voxel_m) > 0:
            raise InvalidValueError(
                f"range_m must be six numbers and voxel_m three > 0, got {self.range_m} and {self.voxel_m}"
            )
        if not (np.asarray(self.range_m[:3]) < self.range_m[3:]).all():
            raise InvalidValueError(f"range_m must begin with the smallest x, y, z, got {self.range_m}")
        names = ("most_points", "most_voxels", "most_agents", "most_objects")
        require_count(1, **{name: getattr(self, name) for name in names})
        require_choice("order", self.order, _ORDERS)
        require_flag(projected=self.projected)

    @property
    def lidar_SE3_base(self) -> SE3:
        """The base frame, whose origin is on the ground, in the frame of the layout."""
        return SE3.from_xyz_yaw([0.0, 0.0, -self.origin_z_m], 0.0)

    def to_rows(self, boxes: Boxes3D) -> Floats:
        """Return boxes of a base frame as rows (N, 7) of the layout."""
        rows = boxes.transform(self.lidar_SE3_base).array.copy()
        rows[:, 3:6] = rows[:, _ORDERS[self.order]]
        return rows

    def to_boxes(self, rows: Floats) -> Boxes3D:
        """Return rows (N, 7) of the layout as boxes of a base frame."""
        rows = np.array(rows, np.float64).reshape(-1, 7)
        rows[:, 3:6] = rows[:, _ORDERS[self.order]]
        return Boxes3D.from_array(rows).transform(self.lidar_SE3_base.inverse())


def make_sample(
    layout: Layout, clouds: Sequence[PointCloud], base_SE3_agents: Sequence[SE3], objects: Boxes3D | None = None,
    ids: Sequence[int] = (),
) -> Batch:  # fmt: skip
    """Return one sample: arrays with a batch of 1.

    Args:
        layout: choices of the network.
        clouds: points of each agent in its base frame, the receiver's first.
        base_SE3_agents: base frames of the agents in the receiver's.
        objects: boxes in the receiver's base frame; None: there are none, as in a policy.
        ids: ids of the objects.
    """
    away = [float(np.hypot(*pose.translation[:2])) for pose in base_SE3_agents]
    nearest = [0, *sorted(range(1, len(clouds)), key=lambda agent: away[agent])][: layout.most_agents]
    placed = [base_SE3_agents[agent] for agent in nearest]
    moved = [clouds[agent].transform(pose) for agent, pose in zip(nearest, placed, strict=True)]
    seen = moved if layout.projected else [clouds[agent] for agent in nearest]
    matrices = np.tile(np.eye(4), (1, layout.most_agents, layout.most_agents, 1, 1))
    if not layout.projected:
        matrices[0, : len(placed), : len(placed)] = _pairwise(layout, placed)
    rows = layout.to_rows(Boxes3D.empty() if objects is None else objects)[: layout.most_objects]
    centres, mask = np.zeros((1, layout.most_objects, 7)), np.zeros((1, layout.most_objects))
    centres[0, : len(rows)], mask[0, : len(rows)] = rows, 1.0
    return {
        "processed_lidar": _stacked([voxelize(layout, cloud.transform(layout.lidar_SE3_base)) for cloud in seen]),
        "record_len": np.array([len(nearest)]),
        "pairwise_t_matrix": matrices,
        "object_bbx_center": centres.astype(np.float32),
        "object_bbx_mask": mask.astype(np.float32),
        "object_ids": [list(map(int, ids))[: layout.most_objects]],
    }


def collate(samples: Sequence[Batch]) -> Batch:
    """Join samples to a batch: voxels count their agents through all samples."""
    before = np.cumsum([0, *(int(sample["record_len"].sum()) for sample in samples)])
    parts = [sample["processed_lidar"] for sample in samples]
    voxels = {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
    counts = [len(part["voxel_coords"]) for part in parts]
    voxels["voxel_coords"][:, 0] += np.repeat(before[:-1], counts)
    joined = {name: np.concatenate([sample[name] for sample in samples]) for name in _ARRAYS}
    return {"processed_lidar": voxels, **joined, "object_ids": [ids for each in samples for ids in each["object_ids"]]}


_ARRAYS = ("record_len", "pairwise_t_matrix", "object_bbx_center", "object_bbx_mask")


def voxelize(layout: Layout, cloud: PointCloud) -> dict[str, NDArray[Any]]:
    """Gather points in voxels, in the order of the points: features, coordinates (0, z, y, x) and numbers of points."""
    low, size = np.array(layout.range_m[:3]), np.array(layout.voxel_m)
    shape = np.round((np.array(layout.range_m[3:]) - low) / size).astype(np.int64)
    cell = np.floor((cloud.xyz - low) / size).astype(np.int64)
    inside = ((cell >= 0) & (cell < shape)).all(axis=1)
    cell, points = cell[inside], np.column_stack([cloud.xyz, cloud.intensity])[inside]
    flat = np.ravel_multi_index(tuple(cell.T), tuple(shape))
    _, first, inverse = np.unique(flat, return_index=True, return_inverse=True)
    voxel = np.argsort(np.argsort(first, kind="stable"), kind="stable")[inverse]  # by each voxel's first point
    order = np.argsort(voxel, kind="stable")
    starts = np.searchsorted(voxel[order], np.arange(len(first)))
    rank = np.empty(len(voxel), np.int64)
    rank[order] = np.arange(len(voxel)) - starts[voxel[order]]
    kept = (voxel < layout.most_voxels) & (rank < layout.most_points)
    count = min(len(first), layout.most_voxels)
    features = np.zeros((count, layout.most_points, 4), np.float32)
    features[voxel[kept], rank[kept]] = points[kept]
    coordinates = np.zeros((count, 4), np.int64)
    coordinates[:, 1:] = cell[np.sort(first)[:count], ::-1]
    numbers = np.bincount(voxel[kept], minlength=count)
    return {"voxel_features": features, "voxel_coords": coordinates, "voxel_num_points": numbers}


def _stacked(parts: Sequence[dict[str, NDArray[Any]]]) -> dict[str, NDArray[Any]]:
    """Stack the voxels of a sample's agents, whose numbers become the first coordinate."""
    for agent, part in enumerate(parts):
        part["voxel_coords"][:, 0] = agent
    return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}


def _pairwise(layout: Layout, ego_SE3_agents: Sequence[SE3]) -> Floats:
    """Return the transforms (N, N, 4, 4) from each agent's frame to each other's."""
    up = layout.lidar_SE3_base
    placed = [up.compose(pose).compose(up.inverse()) for pose in ego_SE3_agents]
    return np.array([[_matrix(to.inverse().compose(of)) for to in placed] for of in placed])


def _matrix(pose: SE3) -> Floats:
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = pose.rotation, pose.translation
    return matrix
