"""Filtering along tracks is the library's tracking, gradients reach the covariances, and end after ten frames."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch
from synthetic_recordings import write_recordings

from coopsim.data.recording_set import RecordingSet
from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.se3 import SE3, Floats
from coopsim.learn.losses.filter_losses import TRUNCATED, errors_along, joined, recording_errors, turned_noise
from coopsim.learn.samples.windows import NONE, RecordedFrames, WindowTracks, frames_of, track_frames
from coopsim.learn.weights import make_network
from coopsim.tracking.ab3dmot_tracker import ab3dmot
from coopsim.types import Detections, seconds_to_ns
from coopsim.types.estimates import diagonals
from coopsim.types.groups import DetectionGroups

NET = make_network("covariance", {"constant": True})


@pytest.fixture(scope="module")
def recordings(tmp_path_factory: pytest.TempPathFactory) -> list[RecordedFrames]:
    path = write_recordings(tmp_path_factory.mktemp("recordings"), frames=15)
    folder = RecordingSet(path)
    return [frames_of(folder.load(name, ("ego", "1")), 0.1) for name in folder.sequences]


def tracked(recorded: RecordedFrames) -> WindowTracks:
    return track_frames(recorded, NET.variances(recorded.numbers), NET.motion())


def with_net(groups: DetectionGroups, variance: Floats, frame: int) -> Detections:
    return replace(groups.joined, covariance=diagonals(variance[frame * 8 : (frame + 1) * 8]))


def test_tracks_are_the_librarys(recordings: list[RecordedFrames]) -> None:
    recorded = recordings[0]
    tracks = tracked(recorded)
    frames, agents, count = tracks.detection.shape
    assert (frames, agents) == (15, 2) and count >= 4
    used = tracks.detection[tracks.detection != NONE]
    assert sorted(used) == list(range(len(recorded.numbers)))  # each detection belongs to one track
    seen = np.isfinite(tracks.truth[:, :, 0]).sum(axis=1)
    assert (seen == 4).all()  # each label has a track


def test_errors_are_those_of_the_librarys_tracker(recordings: list[RecordedFrames]) -> None:
    recorded, variance = recordings[0], NET.variances(recordings[0].numbers)
    motion = NET.motion()
    tracks = tracked(recorded)
    found = errors_along([tracks], [torch.from_numpy(diagonals(variance))], NET.box_filter(), recorded.dt_s)
    tracker, errors = ab3dmot(motion=motion), []
    for frame, groups in enumerate(recorded.found):
        found_now = DetectionGroups(with_net(groups, variance, frame), groups.starts)
        tracker.step_in_turn(found_now, seconds_to_ns(frame * recorded.dt_s))
        now, truth = tracker.state.tracked, tracks.truth[frame]
        for row, identity in enumerate(now.id - 1):
            if np.isfinite(truth[identity]).all():
                errors.append((identity, now.boxes[row, :6] - truth[identity, :6]))
    assert len(errors) == len(found.error) == 15 * 4
    lengths = sorted(np.linalg.norm(difference) for _, difference in errors)
    np.testing.assert_allclose(sorted(found.error.detach()), lengths, atol=1e-5)


def test_gradients_reach_covariances_through_ten_frames_at_most(recordings: list[RecordedFrames]) -> None:
    recorded = recordings[0]
    variance = torch.from_numpy(NET.variances(recorded.numbers)).requires_grad_()
    tracks = tracked(recorded)
    found = errors_along([tracks], [torch.diag_embed(variance)], NET.box_filter(), recorded.dt_s)
    last = np.isfinite(tracks.truth[-1, :, 0]).sum()
    (slope,) = torch.autograd.grad(found.error[-last:].sum(), variance)
    frame = np.repeat(np.arange(15), 8)
    reached = slope.abs().sum(dim=1).numpy() > 0
    assert not reached[frame < TRUNCATED].any()
    assert reached[frame == 14].all() and reached[frame == TRUNCATED].any()


def test_several_windows_are_filtered_as_each_alone(recordings: list[RecordedFrames]) -> None:
    both = recording_errors(NET, recordings)
    alone = [recording_errors(NET, [each]) for each in recordings]
    for name in ("error", "distance", "log_det"):
        together = np.sort(getattr(both, name).detach())
        apart = np.sort(np.concatenate([getattr(each, name).detach() for each in alone]))
        np.testing.assert_allclose(together, apart, rtol=1e-9, atol=1e-12)


def test_windows_of_other_lengths_are_joined(recordings: list[RecordedFrames]) -> None:
    long, short = map(tracked, recordings)
    short = type(short)(short.detection[:3, :1], short.truth[:3], short.boxes)
    detection, truth = joined([long, short])
    assert detection.shape[:2] == long.detection.shape[:2] and truth.shape[0] == 15
    added = detection[:, :, long.detection.shape[2] :]
    assert (added[3:] == NONE).all() and (added[:, 1] == NONE).all()
    assert added.max() >= len(long.boxes)


def test_a_cut_has_what_is_detected_in_it(recordings: list[RecordedFrames]) -> None:
    whole = tracked(recordings[0])
    part, rows = whole.cut(4, 6)
    assert part.detection.shape[0] == len(part.truth) == 6
    np.testing.assert_array_equal(rows, np.arange(4 * 8, 10 * 8))
    np.testing.assert_array_equal(part.boxes, whole.boxes[rows])
    seen = (whole.detection[4:10] != NONE).any(axis=(0, 1))
    again = np.where(part.detection == NONE, NONE, part.detection + 4 * 8)
    np.testing.assert_array_equal(again, whole.detection[4:10][:, :, seen])


def test_nothing_to_filter_has_no_loss() -> None:
    empty = RecordedFrames((), (), np.zeros((0, 19)), 0.1)
    assert [float(loss) for loss in recording_errors(NET, [empty]).losses().values()] == [0.0, 0.0]


def test_noise_turns_with_the_agent_as_the_librarys_covariances_do() -> None:
    rng = np.random.default_rng(0)
    variance, heading_rad = rng.uniform(0.1, 3.0, (6, 7)), rng.uniform(-np.pi, np.pi, 6)
    found = turned_noise(torch.from_numpy(variance), torch.from_numpy(heading_rad)).numpy()
    for row in range(6):
        box = Boxes3D.from_array(np.array([[1.0, 2.0, 0.0, 4.0, 2.0, 1.5, 0.3]]))
        seen = Detections(box, np.ones(1), np.zeros(1, np.int64), diagonals(variance[row : row + 1]))
        turned = seen.transform(SE3.from_xyz_yaw([5.0, -3.0, 0.0], heading_rad[row])).covariance
        assert turned is not None
        np.testing.assert_allclose(found[row], turned[0], atol=1e-12)
