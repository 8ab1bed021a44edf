"""PCD files: what is written reads back, foreign kinds are read, broken ones are named."""

from __future__ import annotations

import struct

import numpy as np
import pytest

from coopsim.data.files.pcd import encode_rgb_pcd, inflate_lzf, read_pcd
from coopsim.errors import InvalidValueError, RecordingError

POINTS = np.array([[1.5, -2.25, 0.125], [100.0, 0.0, -1.0], [3.0, 4.0, 5.0]], np.float32)
INTENSITY = np.array([0.0, 0.5, 1.0], np.float32)


def _header(fields="x y z intensity", size="4 4 4 4", kind="F F F F", points=3, data="binary", extra="COUNT 1 1 1 1\n"):
    return (
        f"# comment\nVERSION .7\nFIELDS {fields}\nSIZE {size}\nTYPE {kind}\n{extra}WIDTH {points}\nHEIGHT 1\n"
        f"VIEWPOINT 0 0 0 1 0 0 0\nPOINTS {points}\nDATA {data}\n"
    ).encode()


def _rows():
    return np.column_stack([POINTS, INTENSITY * 200]).astype("<f4")


def _write(tmp_path, content):
    path = tmp_path / "sweep.pcd"
    path.write_bytes(content)
    return path


def test_what_is_written_reads_back_with_intensity_in_steps_of_a_colour(tmp_path):
    cloud = read_pcd(_write(tmp_path, encode_rgb_pcd(POINTS, INTENSITY)))
    np.testing.assert_array_equal(cloud.points, POINTS)
    np.testing.assert_allclose(cloud.intensity, INTENSITY, atol=0.5 / 255 + 1e-6)


def test_a_written_file_has_the_fields_that_open3d_takes_for_colours():
    header, _, body = encode_rgb_pcd(POINTS, INTENSITY).partition(b"DATA binary\n")
    assert b"FIELDS x y z rgb\nSIZE 4 4 4 4\nTYPE F F F F\n" in header
    assert struct.unpack("<3fI", body[16:32]) == (100.0, 0.0, -1.0, 0x808080)


def test_no_points_are_a_file_too(tmp_path):
    cloud = read_pcd(_write(tmp_path, encode_rgb_pcd(np.zeros((0, 3), np.float32), np.zeros(0, np.float32))))
    assert cloud.points.shape == (0, 3)
    assert cloud.intensity.shape == (0,)


def test_a_field_intensity_keeps_its_unit(tmp_path):
    cloud = read_pcd(_write(tmp_path, _header() + _rows().tobytes()))
    np.testing.assert_array_equal(cloud.points, POINTS)
    np.testing.assert_array_equal(cloud.intensity, INTENSITY * 200)


def test_ascii_is_read_with_its_colours_as_open3d_writes_them(tmp_path):
    packed = np.array([0x80FF01], np.uint32).view(np.float32)[0]
    text = f"1.5 -2 3e1 {packed!r}\n".replace("np.float32(", "").replace(")", "")
    cloud = read_pcd(_write(tmp_path, _header("x y z rgb", points=1, data="ascii") + text.encode()))
    np.testing.assert_allclose(cloud.points, [[1.5, -2.0, 30.0]])
    assert cloud.intensity[0] == pytest.approx(0x80 / 255)


def test_other_fields_are_passed_over_in_any_type_and_number(tmp_path):
    row = np.dtype([("ring", "<u2"), ("x", "<f8"), ("normal", "<f4", (3,)), ("y", "<f4"), ("z", "<f4")])
    rows = np.zeros(2, row)
    rows["x"], rows["y"], rows["z"] = [1, 2], [3, 4], [5, 6]
    header = _header("ring x normal y z", "2 8 4 4 4", "U F F F F", 2, extra="COUNT 1 1 3 1 1\n")
    cloud = read_pcd(_write(tmp_path, header + rows.tobytes()))
    np.testing.assert_array_equal(cloud.points, [[1, 3, 5], [2, 4, 6]])
    assert cloud.intensity is None


def test_points_that_are_not_there_are_left_out(tmp_path):
    rows = _rows()
    rows[1, 2] = np.nan
    cloud = read_pcd(_write(tmp_path, _header() + rows.tobytes()))
    np.testing.assert_array_equal(cloud.points, POINTS[[0, 2]])
    np.testing.assert_array_equal(cloud.intensity, INTENSITY[[0, 2]] * 200)


def test_compressed_data_are_read(tmp_path):
    # Field after field, as literals, with the zeros of one field as a back reference.
    columns = _rows().T.copy()
    columns[1] = 0.0
    plain = columns.tobytes()
    literals = [bytes([len(part) - 1]) + part for part in (plain[:12], plain[12:13])]
    reference = bytes([(7 << 5), 11 - 2 - 7, 0])  # 11 bytes, from one back
    rest = [bytes([len(part) - 1]) + part for part in (plain[24:36], plain[36:])]
    compressed = b"".join([*literals, reference, *rest])
    content = _header(data="binary_compressed") + struct.pack("<2I", len(compressed), len(plain)) + compressed
    cloud = read_pcd(_write(tmp_path, content))
    np.testing.assert_array_equal(cloud.points, columns[:3].T)
    np.testing.assert_array_equal(cloud.intensity, columns[3])


@pytest.mark.parametrize(
    ("content", "named"),
    [
        (b"hello", "DATA"),
        (_header(points=4) + _rows().tobytes(), "POINTS is 4"),
        (_header(points=10**11) + _rows().tobytes(), "cut off"),
        (_header("x y intensity", "4 4 4", "F F F", extra=""), "FIELDS must have z"),
        (_header(size="4 4 4"), "SIZE"),
        (_header(size="4 4 4 3"), "SIZE of intensity"),
        (_header(points="many"), "POINTS"),
        (_header(data="zip"), "DATA must be one of"),
        (_header(extra="COUNT 1 1 1 99999999999\n"), "COUNT of intensity"),
        (_header(points=1, data="ascii") + b"1 2 three 4\n", "three"),
        (_header(points=2, data="ascii") + b"1 2 3 4\n", "1 lines follow"),
        (_header(points=1, data="ascii") + b"1 2 3\n", "4 numbers"),
        (_header(data="binary_compressed") + struct.pack("<2I", 99, 48), "99 compressed bytes"),
        (_header(data="binary_compressed") + struct.pack("<2I", 0, 48), "cannot hold 48"),
        (_header(points=10**9, data="binary_compressed") + struct.pack("<2I", 9, 99) + bytes(9), "POINTS"),
    ],
)
def test_a_broken_file_is_named_with_what_is_wrong(tmp_path, content, named):
    path = _write(tmp_path, content)
    with pytest.raises(RecordingError, match=named) as raised:
        read_pcd(path)
    assert str(path) in str(raised.value)


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(RecordingError, match="cannot read"):
        read_pcd(tmp_path / "none.pcd")


@pytest.mark.parametrize("compressed", [bytes([5, 1]), bytes([0x20, 0]), bytes([0xE0]), bytes([0, 7]), bytes([0x40])])
def test_damaged_compressed_bytes_are_refused(compressed):
    with pytest.raises(InvalidValueError):
        inflate_lzf(compressed, 3)
