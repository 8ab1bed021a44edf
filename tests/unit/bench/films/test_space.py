"""Films in three dimensions: points and boxes come back, little is lost, and the same episode is the same bytes."""

from __future__ import annotations

import base64
import zlib
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from small_env import SMALL
from some_films import some_film

from coopsim.bench.evaluate import evaluate
from coopsim.bench.films.film import Film
from coopsim.bench.films.film_file import film_bytes, read_film
from coopsim.bench.films.filming import Filming
from coopsim.bench.films.space import (
    CLOUD_M,
    LENGTH_M,
    box_rows,
    ground_of,
    on_ground,
    pack_cloud,
    solids_of,
    spread,
    unpack_cloud,
    within_reach,
)
from coopsim.bench.report.space_data import pair_view
from coopsim.geometry.boxes import Boxes3D
from coopsim.world.places.layout import flat_part, rectangle
from coopsim.world.snapshot import StaticPart

LIDAR = SMALL | {"max_cycles": 4, "lidar": "VLP-16"}


@pytest.fixture(scope="module")
def film() -> Film:
    """A short film in three dimensions."""
    return filmed()


def filmed(**change: Any) -> Film:
    filming = Filming(of_each=True, space=300)
    evaluate("late_fusion", "crossing", seed=7, recorders=[filming], **(LIDAR | change))
    return filming.film


def test_points_come_back_to_half_a_step_also_where_they_wrap_around() -> None:
    points = np.random.default_rng(0).uniform(-1600, 1600, (500, 3)) + np.array([5e4, -5e4, 0])
    origin = np.array([5e4, -5e4, 0.0])
    planes = pack_cloud(points, origin)
    assert planes.shape == (500, 6) and planes.dtype == np.uint8
    np.testing.assert_allclose(unpack_cloud(planes, origin), points, atol=CLOUD_M / 2 + 1e-6)
    assert within_reach(points, origin).all() and not within_reach(points + np.array([3000.0, 0, 0]), origin).all()


def test_of_a_dense_cloud_few_points_stay_and_lone_ones_all() -> None:
    dense, lone = np.random.default_rng(1).uniform(0, 1, (4000, 3)), np.array([[50.0, 0, 0], [0, 60.0, 0]])
    kept = spread(np.concatenate([dense, lone]), 100)
    assert len(kept) <= 66 and (kept[-2:] == lone).all(), "a cube of 1 m has 64 cubes of 0.25 m"
    assert len(spread(100 * dense, 100)) == 100 and len(spread(np.zeros((0, 3)), 5)) == 0


def test_boxes_keep_their_place_to_half_a_centimetre() -> None:
    box = Boxes3D.from_array([[12.34, -6.789, 0.8, 4.5, 1.9, 1.6, 3.1]])
    (row,) = box_rows(np.array([2**40 + 3]), box, np.array([0.25])).tolist()
    assert row == [3, 1234, -679, 80, 450, 190, 160, 31000, 250]


def test_solids_know_where_they_stand_and_far_ones_are_left_out() -> None:
    ground = flat_part("ground", [rectangle((-9.0, 9.0), (-9.0, 9.0))], 1.0, (0, 0, 0), 0.3)
    corners, faces = np.array([[0.0, 0, 1], [4, 0, 1], [0, 4, 9]]), np.array([[0, 1, 2]])
    houses = [StaticPart("building", corners + np.array([x, 0, 0]), faces, (0, 0, 0), 0.3) for x in (0.0, 900.0)]
    flat, house = solids_of([*houses, ground], np.zeros((1, 2)))
    assert [flat.kind, house.kind] == ["ground", "house"] and len(house.vertices) == 3
    np.testing.assert_array_equal(house.vertices[:, 3] * LENGTH_M, 1.0)
    on = on_ground(np.array([[1.0, 1, 1.1], [1, 1, 1.5], [0, 0, 5.0]]), ground_of([*houses, ground]))
    assert on.tolist() == [1, 0, 0]


def test_a_film_holds_what_the_frame_has(film: Film) -> None:
    assert {"road", "house"} <= {solid.kind for solid in film.solids} and len(film.frames) == 4
    for frame in film.frames:
        space = frame.space
        assert space is not None and set(space.bodies) == set(frame.agents) == set(space.clouds)
        np.testing.assert_array_equal(space.truth[:, [0, 1, 2, 4, 5, 7]], frame.truth)
        for name, cloud in space.clouds.items():
            assert 0 < len(cloud) <= 300 and len(cloud) == len(space.ground[name])
            assert np.isin(space.seen[name], space.truth[:, 0]).all()
        assert any(len(ids) for ids in space.seen.values())
        assert (space.truth[:, 3] > 0).all() and (space.truth[:, 6] > 50).all()


def test_the_same_episode_is_the_same_bytes_and_comes_back(film: Film, tmp_path: Path) -> None:
    content = film_bytes(film, "key")
    assert content == film_bytes(filmed(), "key")
    (tmp_path / "key.npz").write_bytes(content)
    back = read_film(tmp_path / "key.npz")
    assert film_bytes(back, "key") == content and len(back.solids) == len(film.solids)


def test_older_films_have_no_third_dimension_and_arrays_of_a_film_are_without_gaps(tmp_path: Path) -> None:
    (tmp_path / "key.npz").write_bytes(film_bytes(some_film(), "key"))
    back = read_film(tmp_path / "key.npz")
    assert back.frames[0].space is None and not back.solids
    assert back.drive is not None and back.drive.drive.boxes.flags.c_contiguous, "kernels take no others"


def test_what_a_car_must_not_touch_is_found_in_a_view_however_long_its_id_is(film: Film) -> None:
    id_of_a_person = 5_000_000_000
    (first, *_), drive = film.frames, some_film().drive
    assert first.space is not None and drive is not None
    space = replace(first.space, seen={"cav_0": np.array([id_of_a_person])}, truth=first.space.truth.copy())
    space.truth[0, 0] = box_rows(np.array([id_of_a_person]), Boxes3D.from_array(np.ones((1, 7))))[0, 0]
    drive = replace(drive, drive=replace(drive.drive, ids=np.array([id_of_a_person])))
    view = pair_view(["a", "b"], [replace(film, frames=[replace(first, space=space)], drive=drive)] * 2, "cav_0", 0, 1)
    assert view is not None
    told = view.data()
    assert told["runs"][0]["conflict"] == [space.truth[0, 0]]
    content = zlib.decompress(base64.b64decode(told["worlds"][0][0]["data"]), -zlib.MAX_WBITS)
    agents, count = len(told["worlds"][0][0]["agents"]), told["worlds"][0][0]["count"]
    seen_by_first = content[4 * (5 * agents + 8 * count) :][:count]
    assert seen_by_first[0] == 1 and sum(seen_by_first) == 1
