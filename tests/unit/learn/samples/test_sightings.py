"""Sightings: who saw what, drawn so that positives are of one agent in time or of two agents at once."""

from dataclasses import replace

import numpy as np
import pytest
from clips import seeing_clip, small_clip
from synthetic_clips import SyntheticClips

from coopsim.errors import InvalidValueError
from coopsim.geometry.se3 import SE3, wrap_angle
from coopsim.learn.samples.sightings import (
    SightingSettings,
    compare_sightings,
    draw_groups,
    jittered,
    join_sightings,
    sightings_of,
)

SETTINGS = SightingSettings()


def test_every_agent_has_the_objects_that_it_has_returns_of_in_its_own_frame() -> None:
    clip = small_clip()
    seen = sightings_of(clip, SETTINGS)
    assert len(seen) == sum(int((scene.returns >= 5).sum()) for scene in clip.scenes) > 0
    for row in range(0, len(seen), 7):
        scene = clip.scenes[seen.scene[row]]
        agent, (place,) = scene.agents[seen.agent[row]], np.flatnonzero(scene.object_id == seen.identity[row])
        world_SE3_base = SE3.from_xyz_yaw(agent.xyz_yaw[:3], agent.xyz_yaw[3])
        assert world_SE3_base.apply(seen.boxes[row, :3]) == pytest.approx(scene.boxes[place, :3])
        assert wrap_angle(seen.boxes[row, 6] + agent.xyz_yaw[3] - scene.boxes[place, 6]) == pytest.approx(0, abs=1e-9)
        assert seen.returns[row] == scene.returns[place, seen.agent[row]] and seen.label[row] == scene.label[place]


def test_pixels_are_asked_for_where_there_are_cameras() -> None:
    least = replace(SETTINGS, least_returns=0, least_pixels=30)
    seen = sightings_of(seeing_clip(), least)
    assert len(seen) == sum(int((scene.pixels >= 30).sum()) for scene in seeing_clip().scenes) > 0  # type: ignore
    assert len(sightings_of(small_clip(), least)) == 0


def test_a_group_is_of_one_class_and_its_identities_have_positives() -> None:
    clip = SyntheticClips(agents=3, objects=7, frames=6).clip(0)
    seen = sightings_of(clip, SETTINGS)
    label = np.where(seen.identity < 3, 7, 0)
    seen = replace(seen, label=label)
    groups = draw_groups(seen, np.random.default_rng(0), replace(SETTINGS, group=2))
    assert [len(np.unique(seen.identity[rows])) for rows in groups] == [2, 2, 2, 1]
    whole = seen.take(np.concatenate(groups))
    assert sorted(set(whole.identity.tolist())) == list(range(7))
    for rows in groups:
        assert len(np.unique(seen.label[rows])) == 1
        for identity in np.unique(seen.identity[rows]):
            anchor, time, other = rows[seen.identity[rows] == identity]
            assert seen.agent[anchor] == seen.agent[time] and 1 <= abs(seen.scene[anchor] - seen.scene[time]) <= 3
            assert seen.agent[anchor] != seen.agent[other] and seen.scene[anchor] == seen.scene[other]


def test_objects_seen_once_are_left_out() -> None:
    seen = sightings_of(SyntheticClips(agents=1, frames=1).clip(0), SETTINGS)
    assert len(seen) == 4 and draw_groups(seen, np.random.default_rng(0), SETTINGS) == []
    assert draw_groups(seen.take(np.zeros(0, int)), np.random.default_rng(0), SETTINGS) == []


def test_boxes_err_as_they_are_told_to() -> None:
    one = sightings_of(SyntheticClips().clip(0), SETTINGS)
    seen = join_sightings([one] * 200)
    wrong = jittered(seen, np.random.default_rng(0), replace(SETTINGS, center_m=0.4, turned=0.25))
    error = wrong.boxes - seen.boxes
    assert error[:, :3].std(0) == pytest.approx([0.4, 0.4, 0.2], rel=0.1)
    assert np.log(wrong.boxes[:, 3:6] / seen.boxes[:, 3:6]).std() == pytest.approx(0.06, rel=0.1)
    turned = np.abs(wrap_angle(error[:, 6])) > np.pi / 2
    assert turned.mean() == pytest.approx(0.25, abs=0.03)
    assert np.rad2deg(wrap_angle(error[~turned, 6])).std() == pytest.approx(5.0, rel=0.1)
    right = jittered(one, np.random.default_rng(0), SightingSettings(center_m=0, size_share=0, yaw_deg=0, turned=0))
    assert right.boxes[:, :6] == pytest.approx(one.boxes[:, :6])


def test_pairs_of_one_class_are_compared_once() -> None:
    seen = sightings_of(SyntheticClips(agents=2, objects=3, frames=2).clip(0), SETTINGS)
    seen = replace(seen, label=np.where(seen.identity == 2, 7, 0))
    vectors = np.eye(3)[seen.identity]
    found = compare_sightings(vectors, seen, seen.across_agents())
    assert len(found.same) == 2 * (4 + 1)  # per scene two of the first class by two agents, one of the second
    assert (found.similarity == found.same).all() and found.same.sum() == 2 * 3
    within = compare_sightings(vectors, seen, seen.within_agents(1))
    assert within.same.sum() == 2 * 3 and len(within.same) == 2 * (4 + 1)


@pytest.mark.parametrize("wrong", [{"frames": 0}, {"center_m": -1.0}, {"turned": 2.0}, {"least_pixels": -1}])
def test_settings_are_checked(wrong: dict[str, float]) -> None:
    with pytest.raises(InvalidValueError, match=next(iter(wrong))):
        SightingSettings(**wrong)  # type: ignore[arg-type]
