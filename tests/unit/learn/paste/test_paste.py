"""Pasting from files to files: labels, determinism, sequences, doubts in trainings, and bad input."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from bare_sweeps import write_bare

from coopsim.errors import CoopsimError, InvalidValueError, RecordingError
from coopsim.learn.clips.recorded import RecordedClips
from coopsim.learn.losses.head_losses import heat_loss
from coopsim.learn.paste.paste import PastedFrame, PasteSettings, paste
from coopsim.learn.samples.cloud_samples import SampleSettings, detector_samples
from coopsim.recordings.formats import open_folder

DOUBT = np.array([[15.0, -4.0, 0.8, 4.5, 1.9, 1.6, 0.0]])
MANY = PasteSettings(actors=(12, 12), reach_m=22.0)


def no_doubts(points: np.ndarray) -> np.ndarray:
    return np.zeros((0, 7))


def one_doubt(points: np.ndarray) -> np.ndarray:
    return DOUBT.copy()


@pytest.fixture(scope="module")
def bare(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_bare(tmp_path_factory.mktemp("bare") / "sweeps")


@pytest.fixture(scope="module")
def pasted(bare: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, PastedFrame]:
    out = tmp_path_factory.mktemp("pasted") / "out"
    (frame,) = paste(bare, out, MANY, one_doubt)
    return out, frame


def points_in(points: np.ndarray, box: np.ndarray, margin_m: float = 0.15) -> np.ndarray:
    cos, sin = np.cos(box[6]), np.sin(box[6])
    local = (points[:, :2] - box[:2]) @ np.array([[cos, -sin], [sin, cos]])
    flat = (np.abs(local) < box[3:5] / 2 + margin_m).all(axis=1)
    inside: np.ndarray = flat & (np.abs(points[:, 2] - box[2]) < box[5] / 2 + margin_m)
    return inside


def test_labels_are_those_of_the_returns(pasted: tuple[Path, PastedFrame]) -> None:
    """New points are in labelled boxes, every box has one, and all other points are those of the sweep.

    What is seen through a pane is up to 1.6 m behind it, which may be beyond the vehicle.
    """
    _, frame = pasted
    was = {point.tobytes() for point in frame.before}
    new = np.array([point.tobytes() not in was for point in frame.points])
    assert len(frame.boxes) > 4 and 100 < new.sum() < len(frame.points) / 2
    inside = np.array([points_in(frame.points, box) for box in frame.boxes])
    assert inside[:, new].any(axis=0).mean() > 0.97 and (inside & new).any(axis=1).all()
    assert np.array([points_in(frame.points[new], box, 1.7) for box in frame.boxes]).any(axis=0).all()
    assert len(frame.points) - new.sum() < len(frame.before)  # some are hidden
    assert frame.points[new, 3].max() <= frame.before[:, 3].max() and (frame.points[:, 3] >= 0).all()


def test_actors_stand_on_the_ground_and_in_nothing(pasted: tuple[Path, PastedFrame]) -> None:
    _, frame = pasted
    bottom = frame.boxes[:, 2] - frame.boxes[:, 5] / 2
    assert np.abs(bottom).max() < 0.1
    standing = frame.before[frame.before[:, 2] > 0.3]
    for box in frame.boxes:
        assert not points_in(standing, box, 0.0).any()
        assert np.hypot(*(box[:2] - DOUBT[0, :2])) > 1.5


def test_a_seed_gives_the_same_bytes_and_another_one_other_actors(
    bare: Path, pasted: tuple[Path, PastedFrame], tmp_path: Path
) -> None:
    _, frame = pasted
    (again,) = paste(bare, tmp_path / "again", MANY, one_doubt)
    assert again.path.name == frame.path.name and again.path.read_bytes() == frame.path.read_bytes()
    (other,) = paste(bare, tmp_path / "other", PasteSettings(actors=(12, 12), reach_m=22.0, seed=1), one_doubt)
    assert other.boxes.shape != frame.boxes.shape or np.abs(other.boxes - frame.boxes).max() > 0.1


def test_copies_have_other_actors(bare: Path, tmp_path: Path) -> None:
    frames = list(paste(bare, tmp_path / "out", PasteSettings(actors=(4, 4), copies=2), no_doubts))
    assert len({frame.path for frame in frames}) == 2
    assert frames[0].boxes[:1].tolist() != frames[1].boxes[:1].tolist()


def test_actors_move_steadily_through_consecutive_sweeps(tmp_path: Path) -> None:
    """The car drives 1 m a frame, so that what stands comes 1 m nearer."""
    bare = write_bare(tmp_path / "drive", frames=3, step_s=0.1)
    list(paste(bare, tmp_path / "out", PasteSettings(actors=(8, 8), reach_m=22.0, frames=3), no_doubts))
    folder = open_folder(tmp_path / "out")
    (name,) = folder.sequences
    frames = [folder.open(name).frame(k) for k in range(3)]
    assert [round(frame.time_ns / 1e6) for frame in frames] == [0, 100, 200]
    both, here, there = np.intersect1d(frames[0].objects.id, frames[2].objects.id, return_indices=True)
    moved = frames[2].objects.boxes.center[there, :2] - frames[0].objects.boxes.center[here, :2]
    speed = np.linalg.norm(moved, axis=1) / 0.2
    assert len(both) > 2 and speed.max() < 13.0 and (speed < 1e-6).any()
    middle = dict(zip(frames[1].objects.id.tolist(), frames[1].objects.boxes.center, strict=True))
    for key, start, way in zip(both.tolist(), frames[0].objects.boxes.center[here, :2], moved, strict=True):
        if key in middle:
            np.testing.assert_allclose(middle[key][:2], start + way / 2, atol=1e-6)


def test_what_is_doubtful_counts_neither_way_in_a_training(pasted: tuple[Path, PastedFrame]) -> None:
    out, frame = pasted
    clip = RecordedClips((str(out),), frames=1, dt_s=(1.0,)).clip(0)
    (scene,) = clip.scenes
    assert scene.doubtful is not None and len(scene.boxes) == len(frame.boxes)
    settings = SampleSettings(reach_m=38.4, crop_cells=None, mirrored=0.0, thinned=0.0)
    (sample,) = detector_samples(clip, np.random.default_rng(0), settings)
    ignored = sample.targets.ignored
    assert ignored.any() and ignored.float().mean() < 0.02
    logits = torch.zeros_like(sample.targets.heat, requires_grad=True)
    heat_loss(logits, sample.targets.heat, sample.targets.objects, ignored).backward()
    assert logits.grad is not None
    assert not logits.grad[ignored[:, None].expand_as(logits) & (sample.targets.heat < 1)].any()
    assert (logits.grad[~ignored[:, None].expand_as(logits)] != 0).any()


def test_bad_input_ends_in_one_line(bare: Path, tmp_path: Path) -> None:
    def fails(
        kind: type[CoopsimError], said: str, sweeps: Path = bare, out: Path = tmp_path / "new", **options: Any
    ) -> None:
        with pytest.raises(kind, match=said) as caught:
            list(paste(sweeps, out, PasteSettings(**options), no_doubts))
        assert "\n" not in str(caught.value)

    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "file").touch()
    fails(InvalidValueError, "must be an empty folder", out=tmp_path / "full")
    two = write_bare(tmp_path / "two", frames=2)
    fails(InvalidValueError, "frames must be 1", sweeps=two, out=tmp_path / "other", frames=2)
    fails(RecordingError, "no folder", sweeps=tmp_path / "none")
    fails(InvalidValueError, "actors", actors=(5, 4))
    fails(InvalidValueError, "reach_m", reach_m=500.0)
    broken = tmp_path / "broken"
    broken.mkdir()
    np.savez(broken / "a_0.npz", points=np.zeros((3, 2)))
    fails(RecordingError, "points must be numbers", sweeps=broken)
