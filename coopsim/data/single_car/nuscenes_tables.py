"""Tables of nuScenes: JSON files of records with tokens (Caesar et al., CVPR 2020), joined for the sensors' key frames.

The whole data set's `sample_data.json` has 2.6 million records. It is read once, and of it only key frames of the
LiDAR and the cameras are kept.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from coopsim.data.recordings.file_fields import Fields, as_id, read_json
from coopsim.errors import RecordingError

TABLES = "v1.0-"
"""Beginning of the name of the folder of tables, such as `v1.0-mini`."""

LIDAR = "LIDAR_TOP"
"""Channel of the LiDAR."""

_CAMERA = "CAM_"


def time_us(record: Fields) -> int:
    """Return the time stamp of a record, us."""
    return as_id(record.value("timestamp"), record.file, record.field("timestamp"))


def find_tables(path: Path) -> list[Path]:
    """Return the folders of tables: the one that is given, or all in it, sorted."""
    if _is_tables(path):
        return [path]
    return sorted(entry for entry in path.glob(f"{TABLES}*") if _is_tables(entry))


def _is_tables(path: Path) -> bool:
    return path.name.startswith(TABLES) and any((path / f"{name}.json").is_file() for name in ("scene", "sample"))


@dataclass(frozen=True)
class NuscenesTables:
    """Tables in a folder, each read when first asked for.

    Attributes:
        path: folder of the tables, such as `v1.0-mini`; sensors' files are in the folder around it.
    """

    path: Path

    @cached_property
    def scenes(self) -> Mapping[str, str]:
        """Tokens of the scenes by name, sorted by name."""
        return dict(sorted((each.text("name"), each.text("token")) for each in self._read("scene")))

    def samples(self, scene: str) -> Sequence[Fields]:
        """Return the samples (key frames) of the scene with a token, in order of time."""
        return self._samples.get(scene, ())

    def datum(self, sample: str, channel: str) -> Fields | None:
        """Return the record of a sensor's file of a sample; None: there is none."""
        return self._data.get(sample, {}).get(channel)

    def cameras(self, sample: str) -> Sequence[str]:
        """Return the channels of the cameras with a picture in a sample."""
        return [channel for channel in self._data.get(sample, {}) if channel.startswith(_CAMERA)]

    def linked(self, table: str, record: Fields) -> Fields:
        """Return the record of a table whose token stands in `<table>_token` of another record.

        Raises:
            RecordingError: there is no such record.
        """
        token = record.text(f"{table}_token")
        found = self._by_token(table).get(token)
        if found is None:
            raise record.error(f"{table}_token", f"must be a token of {table}.json, got {token!r}")
        return found

    def annotations(self, sample: str) -> Sequence[Fields]:
        """Return the annotations of a sample."""
        return self._annotations.get(sample, ())

    def file(self, datum: Fields) -> Path:
        """Return the path of a sensor's file, which stays in the folder."""
        name = datum.text("filename")
        if ".." in Path(name).parts or Path(name).is_absolute():
            raise datum.error("filename", f"must be a path in the folder, got {name!r}")
        return self.path.parent / name

    @cached_property
    def _samples(self) -> Mapping[str, Sequence[Fields]]:
        found: dict[str, list[Fields]] = {}
        for each in self._read("sample"):
            found.setdefault(each.text("scene_token"), []).append(each)
        return {scene: sorted(rows, key=time_us) for scene, rows in found.items()}

    @cached_property
    def _annotations(self) -> Mapping[str, Sequence[Fields]]:
        found: dict[str, list[Fields]] = {}
        for each in self._read("sample_annotation"):
            found.setdefault(each.text("sample_token"), []).append(each)
        return found

    @cached_property
    def _data(self) -> Mapping[str, Mapping[str, Fields]]:
        """Records of key frames' files by sample and channel."""
        channels = {
            each.text("token"): self.linked("sensor", each).text("channel")
            for each in self._by_token("calibrated_sensor").values()
        }
        found: dict[str, dict[str, Fields]] = {}
        for each in self._read("sample_data"):
            if not each.value("is_key_frame"):
                continue
            channel = channels.get(each.text("calibrated_sensor_token"), "")
            if channel == LIDAR or channel.startswith(_CAMERA):
                found.setdefault(each.text("sample_token"), {})[channel] = each
        return found

    @cached_property
    def _indices(self) -> dict[str, Mapping[str, Fields]]:
        return {}

    def _by_token(self, table: str) -> Mapping[str, Fields]:
        if table not in self._indices:
            self._indices[table] = {each.text("token"): each for each in self._read(table)}
        return self._indices[table]

    def _read(self, table: str) -> Iterator[Fields]:
        path = self.path / f"{table}.json"
        records: Any = read_json(path)
        if not isinstance(records, list):
            raise RecordingError(f"{path} must be a list of records, got {type(records).__name__}")
        return (Fields(record, path, f"[{number}]") for number, record in enumerate(records))
