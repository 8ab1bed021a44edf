"""A frame's triangles: each actor's mesh where its box is, with its own id and paint."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from sensor_scenes import MODELS, actors, box_model, box_part, ground, triangles

from coopsim.geometry.se3 import SE3
from coopsim.sensors.scene import STATIC_ID, SceneGeometry

PLACES = [[10.0, -3.0, 0.7], [-20.0, 8.0, -2.5], [3.0, 30.0, 3.1]]


def sorted_rows(points: np.ndarray) -> np.ndarray:
    rounded = np.round(points, 9) + 0.0
    return rounded[np.lexsort(rounded.T)]


def test_meshes_stand_where_the_boxes_are() -> None:
    who = actors(PLACES, model=[0, 1, 0], first_id=5)
    soup = triangles(who, [ground()])
    for k, corners in enumerate(who.boxes.corners):
        own = np.unique(soup.faces[soup.instance == who.id[k]])
        np.testing.assert_allclose(sorted_rows(soup.vertices[own]), sorted_rows(corners), atol=1e-8)


def test_faces_know_whose_they_are() -> None:
    soup = triangles(actors(PLACES, model=[0, 1, 0], first_id=5), [ground(reflectivity=0.25)])
    ids, counts = np.unique(soup.instance, return_counts=True)
    np.testing.assert_array_equal(ids, [STATIC_ID, 5, 6, 7])
    np.testing.assert_array_equal(counts, [2, 12, 12, 12])
    assert set(soup.reflectivity[soup.instance == STATIC_ID]) == {0.25}
    assert set(soup.reflectivity[soup.instance == 6]) == {0.8}


def test_tint_decides_how_much_paint_a_face_takes() -> None:
    painted, glass = box_model((2.0, 1.0, 1.0)), box_model((2.0, 1.0, 1.0), tint=0.0)
    soup = SceneGeometry([painted, glass], []).triangles(actors(PLACES[:2], model=[0, 1], color=(10, 200, 90)))
    assert (soup.color[soup.instance == 1] == (10, 200, 90)).all()
    assert (soup.color[soup.instance == 2] < 40).all()


def test_an_accented_face_takes_the_second_colour_and_what_is_not_paint_keeps_its_own() -> None:
    plain = box_model((2.0, 1.0, 1.0), tint=0.5)
    half = np.arange(12) < 6
    model = replace(plain, accented=half, color=np.full((12, 3), 100, dtype=np.uint8))
    who = replace(actors(PLACES[:1], color=(0, 200, 0)), accent=np.array([[200, 0, 0]], dtype=np.uint8))
    color = SceneGeometry([model], []).triangles(who).color
    assert (color[half] == (150, 50, 50)).all() and (color[~half] == (50, 150, 50)).all()


def test_every_actor_is_in_the_pose_of_its_phase() -> None:
    rigid = box_model((2.0, 1.0, 1.0))
    size = np.array([1.0, 1.0, 2.0])
    cube = box_model(size)
    # Four poses, lower and lower.
    poses = np.stack([cube.vertices * [1.0, 1.0, 1.0 - 0.2 * k] for k in range(4)])
    walker = replace(cube, poses=poses)
    who = replace(
        actors([[0.0, 0.0, 0.3], [5.0, 1.0, 0.0], [9.0, 9.0, 2.0], [3.0, 3.0, 1.0]], model=[1, 0, 1, 1]),
        phase=np.array([0.0, 0.9, 0.26, 0.999]),
    )
    geometry = SceneGeometry([rigid, walker], [ground()])
    for turn, expected in ((0.0, (0, 1, 3)), (0.5, (2, 3, 1))):
        now = replace(who, phase=(who.phase + turn) % 1.0)
        soup = geometry.triangles(now)
        for identity, pose in zip((1, 3, 4), expected, strict=True):
            row = identity - 1
            own = soup.vertices[np.unique(soup.faces[soup.instance == identity])]
            local = SE3.from_xyz_yaw(now.boxes.center[row], float(now.boxes.yaw[row])).inverse().apply(own)
            np.testing.assert_allclose(local, poses[pose], atol=1e-9)
        rigid_one = soup.vertices[np.unique(soup.faces[soup.instance == 2])]
        np.testing.assert_allclose(rigid_one, rigid.vertices + now.boxes.center[1], atol=1e-9)


def test_dark_paint_is_dark_to_a_lidar_and_dark_glass_is_as_it_was() -> None:
    painted, glass = box_model((2.0, 1.0, 1.0)), box_model((2.0, 1.0, 1.0), tint=0.0)
    shares = {(250, 250, 250): 1.0, (20, 30, 200): 1.0, (51, 51, 51): 0.5, (10, 10, 10): 0.1}
    for color, share in shares.items():
        soup = SceneGeometry([painted, glass], []).triangles(actors(PLACES[:2], model=[0, 1], color=color))
        np.testing.assert_allclose(soup.reflectivity[soup.instance == 1], 0.5 * share)
        np.testing.assert_allclose(soup.reflectivity[soup.instance == 2], 0.5)


def test_normals_are_unit_and_point_outwards() -> None:
    who = actors(PLACES)
    soup = triangles(who)
    np.testing.assert_allclose(np.linalg.norm(soup.normals, axis=1), 1.0, atol=1e-9)
    outwards = soup.vertices[soup.faces].mean(axis=1) - who.boxes.center[soup.instance - 1]
    assert (np.einsum("ij,ij->i", outwards, soup.normals) > 0).all()


def test_a_later_frame_leaves_an_earlier_one_alone() -> None:
    geometry = SceneGeometry(MODELS, [ground()])
    before = geometry.triangles(actors(PLACES))
    kept = before.vertices.copy()
    geometry.triangles(actors(np.array(PLACES) + 1.0))
    np.testing.assert_array_equal(before.vertices, kept)


def test_what_was_kept_from_earlier_frames_never_shows() -> None:
    """Actors that come, go, change order, or are others under the same id: as if seen for the first time."""
    who, static = actors(PLACES, model=[0, 1, 0]), [ground(), box_part([0, 9, 2], (4, 1, 4))]
    geometry = SceneGeometry(MODELS, static)
    frames = [
        who,
        who[np.array([2, 0])],
        who[:0],
        actors(PLACES, model=[1, 1, 0]),
        actors(PLACES, model=[1, 1, 0], color=(0, 0, 250)),
    ]
    for frame in frames:
        got, want = geometry.triangles(frame), SceneGeometry(MODELS, static).triangles(frame)
        for name in ("vertices", "faces", "instance", "reflectivity", "color"):
            np.testing.assert_array_equal(getattr(got, name), getattr(want, name))


def test_an_empty_world_has_no_triangles() -> None:
    assert len(triangles().faces) == len(triangles().vertices) == 0


def test_what_a_part_says_of_being_closed_is_taken_without_a_look() -> None:
    box = box_part([0, 9, 2], (4, 1, 4))
    static = [ground(), box, replace(box, closed=False), replace(ground(), closed=True)]
    parts = triangles(static=static).parts
    assert parts is not None and parts.closed.tolist() == [False, True, False, True]
