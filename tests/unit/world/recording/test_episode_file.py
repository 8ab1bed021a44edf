"""Recorded episodes: what goes in comes out to the last bit, and what is not whole is refused."""

from __future__ import annotations

import json
import struct
import zlib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

import coopsim
from coopsim.errors import InvalidValueError, RecordingError
from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.se3 import SE3
from coopsim.world.recording.episode_file import MAGIC, Episode, EpisodeAgent, EpisodeHeader, EpisodeWriter
from coopsim.world.snapshot import Actors, AgentBody

HEADER = EpisodeHeader(
    "crossing", {"vehicles": 3}, 7, 0.1, (EpisodeAgent("rsu_0", "rsu", None, 5.0),), {"box": (4.0, 2.0, 1.6)}
)


def some_actors(rng: np.random.Generator, count: int, scale_m: float = 100.0) -> Actors:
    box = np.column_stack(
        [rng.normal(0, scale_m, (count, 3)), rng.uniform(0.1, 20, (count, 3)), rng.normal(0, 3, count)]
    )
    color, accent = rng.integers(0, 256, (2, count, 3), dtype=np.uint8)
    label = rng.integers(0, 9, count)
    return Actors(
        rng.integers(1, 2**60, count),
        Boxes3D.from_array(box),
        rng.normal(0, 10, (count, 2)),
        label,
        np.zeros(count, dtype=np.int64),
        color,
        accent,
        rng.random(count),
    )


def agents(x_m: float) -> dict[str, AgentBody]:
    return {"rsu_0": AgentBody("rsu_0", "rsu", None, SE3.from_xyz_yaw([x_m, -0.0, 1e-300], x_m / 7), 5.0)}


def everything(actors: Actors) -> list[NDArray[Any]]:
    columns = (actors.id, actors.boxes.array, actors.velocity, actors.label, actors.model, actors.color, actors.accent)
    return [*columns, actors.phase]


def write(path: Path, frames: int = 3, count: int = 4) -> Path:
    rng = np.random.default_rng(0)
    writer = EpisodeWriter(path, HEADER)
    for k in range(frames):
        writer.append(some_actors(rng, count), agents(float(k)))
    return path


@settings(max_examples=30)
@given(seed=st.integers(0, 2**32), counts=st.lists(st.integers(0, 5), min_size=1, max_size=6))
def test_every_bit_comes_back_also_where_actors_come_and_go(
    tmp_path_factory: pytest.TempPathFactory, seed: int, counts: list[int]
) -> None:
    path = tmp_path_factory.mktemp("episode") / "run.coopsim"
    rng = np.random.default_rng(seed)
    written = [(some_actors(rng, count, 10.0 ** rng.integers(-9, 9)), agents(rng.normal())) for count in counts]
    writer = EpisodeWriter(path, HEADER)
    for frame in written:
        writer.append(*frame)
    episode = Episode(path)
    assert episode.header == HEADER
    assert (episode.frames, episode.most_actors) == (len(counts), max(counts))
    for (actors, bodies), frame in zip(written, episode, strict=True):
        for column, again in zip(everything(actors), everything(frame.actors), strict=True):
            assert column.dtype == again.dtype
            assert column.tobytes() == again.tobytes()
        pose, pose_again = (each["rsu_0"].world_SE3_base for each in (bodies, frame.agents))
        assert pose.rotation.tobytes() == pose_again.rotation.tobytes()
        assert pose.translation.tobytes() == pose_again.translation.tobytes()


def test_even_motion_costs_almost_nothing(tmp_path: Path) -> None:
    sizes = []
    for frames in (50, 100):
        writer, actors = EpisodeWriter(tmp_path / f"{frames}", HEADER), some_actors(np.random.default_rng(0), 100)
        for _ in range(frames):
            writer.append(actors, agents(1.0))
        sizes.append(Episode(writer.path).size_bytes)
    assert (sizes[1] - sizes[0]) / 50 < 100  # of 15 296 bytes


def test_what_was_appended_can_be_played_while_the_recording_goes_on(tmp_path: Path) -> None:
    path, rng = tmp_path / "run.coopsim", np.random.default_rng(0)
    writer = EpisodeWriter(path, HEADER)
    for k in range(1, 4):
        writer.append(some_actors(rng, 2), agents(0.0))
        assert Episode(path).frames == len(list(Episode(path))) == k


def test_a_file_cut_anywhere_is_refused_or_ends_after_a_whole_frame(tmp_path: Path) -> None:
    data = write(tmp_path / "whole", count=1).read_bytes()
    cut, whole = tmp_path / "cut", 0
    for length in range(len(data)):
        cut.write_bytes(data[:length])
        try:
            assert Episode(cut).frames < 3
            whole += 1
        except RecordingError as error:
            assert str(cut) in str(error)  # noqa: PT017  (most lengths raise, two do not)
    assert whole == 2


def test_any_damaged_byte_is_found(tmp_path: Path) -> None:
    data = write(tmp_path / "whole", frames=2, count=1).read_bytes()
    damaged = tmp_path / "damaged"
    for place in range(len(data)):
        damaged.write_bytes(data[:place] + bytes([data[place] ^ 0x41]) + data[place + 1 :])
        with pytest.raises(RecordingError, match="damaged"):
            Episode(damaged)


def test_frames_of_two_recordings_are_not_mixed_up(tmp_path: Path) -> None:
    """Two environments that record into one file."""
    rng = np.random.default_rng(0)
    writers = [EpisodeWriter(tmp_path / "one", HEADER) for _ in range(2)]
    for writer in writers:
        writer.append(some_actors(rng, 2), agents(0.0))
    with pytest.raises(RecordingError, match="damaged in frame 1, 1 whole"):
        Episode(tmp_path / "one")


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (b"", "is no recorded episode; accepted: a file that `coopsim record`"),
        (b"PK\x03\x04 a zip file", "is no recorded episode"),
        (MAGIC, "cut off in its header"),
        (MAGIC + struct.pack("<3I", 3, 0, 0), r"format version 3, .* accepted: versions 1 and 2"),
        (MAGIC + struct.pack("<3I", 1, 99, 0), "cut off or damaged in its header"),
        (MAGIC + struct.pack("<3I", 1, 2, zlib.crc32(b"{}")) + b"{}", "invalid header"),
        (MAGIC + struct.pack("<3I", 1, 2, zlib.crc32(b"[]")) + b"[]", "invalid header"),
        (MAGIC + struct.pack("<3I", 1, 100_000, zlib.crc32(b"[" * 100_000)) + b"[" * 100_000, "invalid header"),
    ],
)
def test_what_is_no_recording_is_refused(tmp_path: Path, content: bytes, said: str) -> None:
    path = tmp_path / "odd"
    path.write_bytes(content)
    with pytest.raises(RecordingError, match=said):
        Episode(path)


def test_a_frame_of_more_actors_than_a_place_has_room_for_is_refused(tmp_path: Path) -> None:
    """A few megabytes of zeros would be inflated to as many gigabytes."""
    path = write(tmp_path / "run", frames=0)
    place, payload = (0, 2**31, 1, 4), b"zero"
    checksum = zlib.crc32(payload, zlib.crc32(struct.pack("<4I", *place)))
    path.write_bytes(path.read_bytes() + struct.pack("<5I", *place, checksum) + payload)
    with pytest.raises(RecordingError, match="damaged in frame 0"):
        Episode(path)


def test_missing_files_and_wrong_types_are_told_apart(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match=r"cannot read .*none: No such file"):
        Episode(tmp_path / "none")
    with pytest.raises(RecordingError, match="Is a directory"):
        Episode(tmp_path)
    with pytest.raises(InvalidValueError, match="must be the file of a recorded episode, got 3"):
        Episode(3)  # type: ignore[arg-type]
    with pytest.raises(InvalidValueError, match="cannot write"):
        EpisodeWriter(tmp_path / "no" / "such" / "folder", HEADER)
    EpisodeWriter(tmp_path / "empty", HEADER)
    with pytest.raises(RecordingError, match="holds no frame"):
        Episode(tmp_path / "empty")


def test_a_recording_that_was_taken_away_is_not_begun_anew_in_the_middle(tmp_path: Path) -> None:
    writer = EpisodeWriter(tmp_path / "run", HEADER)
    writer.path.unlink()
    with pytest.raises(InvalidValueError, match=r"cannot write .*No such file"):
        writer.append(some_actors(np.random.default_rng(0), 1), agents(0.0))


@pytest.mark.parametrize("odd", ["model", "boxes"])
def test_a_frame_that_no_world_can_show_is_refused(tmp_path: Path, odd: str) -> None:
    actors = some_actors(np.random.default_rng(0), 2)
    wrong: dict[str, Any] = {"model": actors.model + 1, "boxes": Boxes3D.from_array(np.full((2, 7), np.nan))}
    columns = ("id", "boxes", "velocity", "label", "model", "color", "accent", "phase")
    rows = {name: getattr(actors, name) for name in columns} | {odd: wrong[odd]}
    EpisodeWriter(tmp_path / "odd", HEADER).append(Actors(**rows), agents(0.0))
    with pytest.raises(RecordingError, match="damaged in frame 0"):
        list(Episode(tmp_path / "odd"))


@pytest.mark.parametrize(
    ("field", "value"), [("population", 5), ("seed", "x"), ("dt_s", 0.0), ("agents", 3), ("models", [1]), ("odd", 1)]
)
def test_a_header_of_other_types_is_refused(tmp_path: Path, field: str, value: object) -> None:
    whole = write(tmp_path / "whole").read_bytes()
    at = len(MAGIC) + 12
    length = struct.unpack_from("<3I", whole, len(MAGIC))[1]
    text = json.dumps(json.loads(whole[at : at + length]) | {field: value}).encode()
    start = struct.pack("<3I", 1, len(text), zlib.crc32(text))
    (tmp_path / "other").write_bytes(MAGIC + start + text + whole[at + length :])
    with pytest.raises(RecordingError, match="has an invalid header"):
        Episode(tmp_path / "other")


@pytest.mark.parametrize("path", [None, 3])
def test_only_a_path_is_written_to(path: Any) -> None:
    with pytest.raises(InvalidValueError, match="path must be that of a file to write, got"):
        EpisodeWriter(path, HEADER)


@pytest.mark.parametrize("name", ["run.csv", "run.mp4", "run.JSON"])
def test_a_name_of_another_format_is_refused(name: str, tmp_path: Path) -> None:
    with pytest.raises(InvalidValueError, match=r"its name must end in \.coopsim, \.rec or nothing, got .*run\."):
        EpisodeWriter(tmp_path / name, HEADER)
    with pytest.raises(InvalidValueError, match=r"its name must end in"):
        coopsim.parallel_env("crossing", lidar=None, record=tmp_path / name)
    assert not (tmp_path / name).exists() and EpisodeWriter(tmp_path / "run.REC", HEADER)
