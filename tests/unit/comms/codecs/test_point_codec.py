"""Points and voxels come back within their stated errors."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from codec_samples import some_points
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.spatial import cKDTree

from coopsim.comms.codecs.point_codec import PointNumber, PointsCodec, VoxelsCodec
from coopsim.errors import CodecError, InvalidValueError, UnknownNameError
from coopsim.types import PointCloud, Sweep

QUICK = settings(max_examples=60)
SHARE = {"float32": 0.0, "float16": 2.0**-11, "int16": 1 / 65_000}
"""The errors that docs/reference/codecs.md states: of a coordinate, and for int16 of the largest."""

LEAST_M = {"float32": 0.0, "float16": 2.0**-25, "int16": 2.0**-126}  # where numbers, or the step, run out of bits
INTENSITY_ERROR = {"float32": 0.0, "float16": 2.0**-12, "int16": 0.5 / 255}
NUMBERS: list[tuple[PointNumber, int]] = [("float32", 16), ("float16", 8), ("int16", 7)]


def clouds(extent_m: float) -> st.SearchStrategy[PointCloud]:
    """Of few points, near and far, many of them at the same places."""
    often = [0.0, 0.2, -0.2, extent_m, -extent_m, 1e-30, 1e-40, 1e-45]
    coordinates = st.one_of(st.floats(-extent_m, extent_m, width=32), st.sampled_from(often))
    xyz = st.integers(0, 12).flatmap(lambda count: arrays(np.float32, (count, 3), elements=coordinates))
    return xyz.map(lambda rows: PointCloud(rows, np.linspace(0, 1, len(rows), dtype=np.float32)))


@pytest.mark.parametrize(("number", "size"), NUMBERS)
@QUICK
@given(cloud=clouds(2048.0))
def test_points_come_back_within_the_stated_errors(number: PointNumber, size: int, cloud: PointCloud) -> None:
    codec = PointsCodec(number)
    payload = codec.encode(cloud)
    got = PointsCodec().decode(payload)  # a payload says itself what it is
    assert len(payload) == 9 + size * len(cloud)
    of = cloud.extent_m if number == "int16" else np.abs(cloud.xyz)
    assert (np.abs(got.xyz - cloud.xyz) <= np.maximum(SHARE[number] * of, LEAST_M[number])).all()
    assert codec.error_m(100.0) == pytest.approx(100 * SHARE[number])
    assert np.abs(got.intensity - cloud.intensity).max(initial=0) <= INTENSITY_ERROR[number] + 1e-7


@pytest.mark.parametrize("voxel_m", [0.05, 0.2, 7.3])
@QUICK
@given(cloud=clouds(30.0))
def test_every_point_has_a_voxel_within_half_its_edge_and_every_voxel_a_point(
    voxel_m: float, cloud: PointCloud
) -> None:
    codec = VoxelsCodec(voxel_m)
    got = VoxelsCodec().decode(codec.encode(cloud))
    bound = voxel_m / 2 + 2.0**-24 * (30.0 + voxel_m)  # half a voxel, as float32 has it
    assert len(got) <= len(cloud)
    if len(cloud):
        away = np.abs(got.xyz[:, None].astype(float) - cloud.xyz[None].astype(float)).max(axis=2)
        assert away.min(axis=0).max() <= bound and away.min(axis=1).max() <= bound
        assert len(np.unique(got.xyz, axis=0)) == len(got)
    assert codec.encode(got) == codec.encode(codec.decode(codec.encode(got)))


def test_a_voxels_intensity_is_the_mean_of_its_points() -> None:
    xyz = np.array([[1.01, 1, 1], [1.02, 1, 1], [5, 5, 5]], dtype=np.float32)
    got = VoxelsCodec(0.5).decode(VoxelsCodec(0.5).encode(PointCloud(xyz, np.array([0.2, 0.4, 0.9], np.float32))))
    np.testing.assert_allclose(np.sort(got.intensity), [0.3, 0.9], atol=0.5 / 255 + 1e-5)


def test_voxels_are_far_smaller_than_the_points_in_them() -> None:
    cloud = some_points(50_000)
    sizes = [len(codec.encode(cloud)) for codec in (PointsCodec("float32"), PointsCodec("int16"), VoxelsCodec(0.2))]
    assert sizes[0] > 2 * sizes[1] > 4 * sizes[2]
    tree = cKDTree(VoxelsCodec().decode(VoxelsCodec(0.2).encode(cloud)).xyz)
    assert tree.query(cloud.xyz, p=np.inf)[0].max() <= 0.1 + 1e-5


def test_a_sweep_is_a_cloud() -> None:
    cloud = some_points(9)
    sweep = Sweep(cloud.xyz, cloud.intensity, np.zeros(9, dtype=np.int64))
    assert PointsCodec("float32").decode(PointsCodec("float32").encode(PointCloud.of(sweep))).extent_m == cloud.extent_m


def cloud_with(xyz: Any, intensity: float = 0.5) -> PointCloud:
    rows = np.array([[0.0, 0, 0], [xyz, 0, 0]], dtype=np.float32)
    return PointCloud(rows, np.full(2, intensity, dtype=np.float32))


@pytest.mark.parametrize(
    ("codec", "cloud", "match"),
    [
        (PointsCodec(), cloud_with(np.nan), "points must be finite"),
        (VoxelsCodec(), cloud_with(np.inf), "points must be finite"),
        (PointsCodec(), cloud_with(1, intensity=1.5), r"intensities of points must be in \[0, 1\]"),
        (PointsCodec("float16"), cloud_with(70_000), "float16 ends at 65504 m, got 70000 m"),
        (VoxelsCodec(), cloud_with(1e9), "too far for voxels of 0.2 m"),
        (VoxelsCodec(0.001), PointCloud(np.diag([2000.0] * 3).astype(np.float32), np.zeros(3)), "less than 2.32"),
        (PointsCodec(), PointCloud(np.zeros((2**20 + 1, 3)), np.zeros(2**20 + 1)), "at most 1048576 points"),
    ],
)
def test_what_cannot_be_sent_is_refused(codec: Any, cloud: PointCloud, match: str) -> None:
    with pytest.raises(CodecError, match=match):
        codec.encode(cloud)


def test_bad_settings_are_refused() -> None:
    with pytest.raises(UnknownNameError, match=r"unknown number 'int61'. Did you mean 'int16'"):
        PointsCodec("int61")  # type: ignore[arg-type]
    with pytest.raises(InvalidValueError, match=r"voxel_m must be in \[0.001, 100\], got 0"):
        VoxelsCodec(0)
