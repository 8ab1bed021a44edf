"""Films on disk: nothing is lost on the way, the same film is the same bytes, and what is broken is noticed."""

from __future__ import annotations

import io
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from some_films import some_film

from coopsim.bench.films.film import Film
from coopsim.bench.films.film_file import _checksum, film_bytes, read_film
from coopsim.errors import StoreError


@pytest.fixture
def path(tmp_path: Path) -> Path:
    path = tmp_path / "key.npz"
    path.write_bytes(film_bytes(some_film(), "key"))
    return path


def test_nothing_is_lost_and_the_bytes_are_the_same(path: Path) -> None:
    film, back = some_film(), read_film(path)
    assert [frame.lights for frame in back.frames] == ["Gr", "rG"]
    assert film_bytes(back, "key") == path.read_bytes() == film_bytes(film, "key")
    assert back.arrived == film.arrived and back.dt_s == film.dt_s
    for one, two in zip(film.frames, back.frames, strict=True):
        assert one.time_ns == two.time_ns and one.agents == two.agents
        np.testing.assert_array_equal(one.truth, two.truth)
        for name, points in one.points.items():
            np.testing.assert_array_equal(points, two.points[name])
        np.testing.assert_array_equal(one.tracks["cav_0"], two.tracks["cav_0"])
        assert [lie.stated_m for lie in one.lies] == [lie.stated_m and tuple(lie.stated_m) for lie in two.lies]
        assert two.told["cav_0"].tolist() == one.told["cav_0"].tolist() == [1]
    for lane, read in zip(film.road_map.lanes, back.road_map.lanes, strict=True):
        np.testing.assert_array_equal(lane, read)
    assert film.drive is not None and back.drive is not None
    assert back.drive.agent == "cav_0" and back.drive.first_seen == {"rsu_0": 1}
    for name in ("time_s", "car", "boxes", "ids", "in_conflict", "crashed", "command_m_s2"):
        np.testing.assert_allclose(getattr(back.drive.drive, name), getattr(film.drive.drive, name), atol=1e-6)
    for way, other in zip(film.drive.drive.ways, back.drive.drive.ways, strict=True):
        np.testing.assert_allclose(way.points, other.points, atol=0.025)
    assert [len(each.label) for each in back.drive.drive.tracks] == [0, 1, 2]


def test_a_film_without_a_drive_and_without_frames_comes_back(tmp_path: Path) -> None:
    path = tmp_path / "a.npz"
    path.write_bytes(film_bytes(Film(0.1, some_film().road_map, []), "a"))
    back = read_film(path)
    assert not back.frames and back.drive is None


@pytest.mark.parametrize("at", [0, 400, 2000])
def test_a_changed_byte_is_noticed(path: Path, at: int) -> None:
    content = bytearray(path.read_bytes())
    content[at] ^= 0x55
    path.write_bytes(bytes(content))
    with pytest.raises(StoreError, match=r"the film .*key\.npz is broken: "):
        read_film(path)


def test_what_is_cut_off_missing_or_of_another_run_is_named(path: Path) -> None:
    other = path.with_name("other.npz")
    other.write_bytes(path.read_bytes())
    with pytest.raises(StoreError, match=r"other\.npz is broken: it is of another format, or of another run"):
        read_film(other)
    other.write_bytes(path.read_bytes()[:-200])
    with pytest.raises(StoreError, match=r"other\.npz is broken"):
        read_film(other)
    other.unlink()
    with pytest.raises(StoreError, match=r"other\.npz is broken: No such file"):
        read_film(other)


def forge(path: Path, **changed: Any) -> None:
    """Change what a film says of itself, and give it a checksum that fits."""
    with np.load(path) as arrays:
        made = {name: arrays[name] for name in arrays.files if name != "checksum"}
    about = json.loads(made["about"].tobytes())
    about["film"] |= changed
    made["about"] = np.frombuffer(json.dumps(about).encode(), np.uint8)
    content = io.BytesIO()
    np.savez_compressed(content, **made, checksum=_checksum(made))
    path.write_bytes(content.getvalue())


@pytest.mark.parametrize(
    "changed",
    [
        {"dt_s": float("nan")},
        {"road_map": {"lanes": [{"\0array": ["float64_2", 10**9, 2]}]}},
        {"road_map": {"lanes": [{"\0array": ["float64_2", -1, 2]}]}},
        {"road_map": {"lanes": [{"\0array": ["other", 1, 2]}]}},
        {"frames": [{"time_ns": 0}]},
        {"frames": [[]]},
        {"arrived": 7},
        {"drive": 7},
    ],
)
def test_a_forged_film_is_refused(path: Path, changed: dict[str, Any]) -> None:
    forge(path, **changed)
    with pytest.raises(StoreError, match="is broken"):
        read_film(path)
