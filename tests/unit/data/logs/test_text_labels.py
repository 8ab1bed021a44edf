"""Label files of KITTI tracking and V2V4Real as logs."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from coopsim.data.logs.reading import read_log
from coopsim.errors import CoopsimError

KITTI = """0 -1 DontCare -1 -1 -10 1 2 3 4 -1000 -1000 -1000 -10 -1 -1 -1
0 7 Car 0 0 0 10 20 30 40 1.5 1.8 4.2 0 1.6 20 -1.5707963
1 7 Car 0 0 0 10 20 30 40 1.5 1.8 4.2 0 1.6 19 -1.5707963
2 7 Car 0 0 0 10 20 30 40 1.5 1.8 4.2 0 1.6 18 -1.5707963
"""
"""A car that stands 20 m ahead; x, y and z of the files lead right, down and ahead."""

POSES = "".join(f"1 0 0 0 0 1 0 0 0 0 1 {k}\n" for k in range(4))
"""The recording car drives 1 m ahead in each frame."""

V2V4REAL = """0 1 Car 0 0 0 0 0 0 0 1.5 1.8 4.2 20 -1 3 0.5
1 1 Car 0 0 0 0 0 0 0 1.5 1.8 4.2 19 -1 3 0.5
"""


def write(folder: Path, labels: str, poses: str | None = None) -> Path:
    for name, text in (("labels", labels), ("poses", poses)):
        if text is not None:
            (folder / name).mkdir()
            (folder / name / "0003.txt").write_text(text)
    return folder


def test_with_poses_what_stands_stands(tmp_path: Path) -> None:
    log = read_log(write(tmp_path, KITTI, POSES))
    car, ego = log.ids.index("7"), log.ids.index("ego")
    assert log.owner == ego
    for k, time_s in enumerate((0.0, 0.1, 0.2)):
        now = log.at(time_s)
        np.testing.assert_allclose(now.place[car], [20, 0, -1.6], atol=1e-9)
        np.testing.assert_allclose(now.place[ego, :2], [k, 0], atol=1e-9)
        np.testing.assert_allclose(now.heading, 0.0, atol=1e-6)
    np.testing.assert_allclose(log.size[car], [4.2, 1.8, 1.5])


def test_without_poses_the_plane_is_the_cars_own(tmp_path: Path) -> None:
    log = read_log(write(tmp_path, V2V4REAL), "0003")
    now = log.at(0.1)
    car, ego = log.ids.index("1"), log.ids.index("ego")
    np.testing.assert_allclose(now.place[car], [19, 3, -1.75])  # x ahead, the third to the left, the second up
    np.testing.assert_allclose(now.place[ego, :2], 0.0)
    assert now.heading[car] == pytest.approx(0.5)


@pytest.mark.parametrize(
    ("labels", "poses", "part", "said"),
    [
        (KITTI, None, "0009", "accepted: 0003"),
        ("0 -1 DontCare -1 -1 -10 1 2 3 4 -1000 -1000 -1000 -10 -1 -1 -1\n", None, None, "no road user"),
        (KITTI.replace("1.5 1.8", "1.5 x"), None, None, "line 2: 'x' is not a number"),
        (KITTI, "1 0 0 0 0 1 0 0 0 0 1 0\n", None, "a pose for each of 3 frames"),
    ],
)
def test_what_is_wrong_is_one_line(tmp_path: Path, labels: str, poses: str | None, part: str | None, said: str) -> None:
    with pytest.raises(CoopsimError) as found:
        read_log(write(tmp_path, labels, poses), part)
    assert said in str(found.value) and "\n" not in str(found.value)
