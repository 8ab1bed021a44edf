"""Folders of KITTI's object benchmark: single frames of one car, labelled in its left colour camera's view.

| file | read as |
|---|---|
| `velodyne/<frame>.bin` | rows of four float32: x, y, z m in the LiDAR's frame, reflectance in [0, 1] |
| `label_2/<frame>.txt` | as `coopsim.data.kitti`, in the rectified camera's frame |
| `calib/<frame>.txt` | `P2`, `R0_rect`, `Tr_velo_to_cam` |
| `image_2/<frame>.png` | the pictures |

The frames are unrelated: they make one sequence, through which the car stands, and objects have new ids in each. As in
KITTI tracking, only points in the picture are kept unless the option `points` is "all".
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from coopsim.data.kitti import read_object_labels
from coopsim.data.recordings.labelled_rows import ids_of_frame
from coopsim.data.single_car.kitti_calibration import (
    CLOUDS,
    HEIGHT_M,
    KittiFrame,
    frame_number,
    has_clouds_and,
    lifted,
    read_kitti_calibration,
    root_of,
)
from coopsim.errors import RecordingError
from coopsim.recordings.formats import RECORDINGS
from coopsim.recordings.recorded_folder import (
    IN_PICTURE,
    UNRELATED_S,
    RecordedFrame,
    RecordedObjects,
    RecordedSequence,
    SingleCarFolder,
)
from coopsim.types import seconds_to_ns

LABELS = "label_2"


@RECORDINGS.register("kitti_object")
@dataclass(frozen=True)
class KittiObjectFolder(SingleCarFolder):
    """A folder of KITTI's object benchmark: `training`, or the one above."""

    layout = "velodyne/<frame>.bin with label_2/ and calib/ (KITTI object)"
    asked = 21
    usual_height_m = HEIGHT_M
    usual_frame_s = UNRELATED_S
    stands_alone = True

    @classmethod
    def found_in(cls, path: Path) -> bool:
        return has_clouds_and(path, LABELS)

    @cached_property
    def root(self) -> Path:
        """The folder with `velodyne` and `label_2`."""
        return root_of(self.path)

    @property
    def sequences(self) -> tuple[str, ...]:
        return (self.root.name or "training",)

    def _open(self, sequence: str) -> KittiObjectSequence:
        clouds = [path for path in (self.root / CLOUDS).iterdir() if path.suffix == ".bin"]
        if not clouds:
            raise RecordingError(f"{self.root / CLOUDS} has no <frame>.bin")
        return KittiObjectSequence(
            sequence,
            self.agents(sequence),
            self.frame_s,
            self.root,
            stems=tuple(path.stem for path in sorted(clouds, key=frame_number)),
            height_m=self.options.height_m("cav", HEIGHT_M),
            in_picture=self.options.points == IN_PICTURE,
        )


@dataclass(frozen=True)
class KittiObjectSequence(RecordedSequence):
    """All frames of a folder.

    Attributes:
        root: the folder with `velodyne` and `label_2`.
        stems: names of the frames' files without their endings, in order.
        height_m: height of the LiDAR over the ground.
        in_picture: keep only the points in the picture.
    """

    root: Path
    stems: tuple[str, ...]
    height_m: float
    in_picture: bool

    @property
    def frames(self) -> int:
        return len(self.stems)

    def frame(self, number: int) -> RecordedFrame:
        stem = self.stems[number]
        calibration = read_kitti_calibration(self.root / "calib" / f"{stem}.txt")
        cloud, picture = self.root / CLOUDS / f"{stem}.bin", self.root / "image_2" / stem
        files, world_SE3_lidar = KittiFrame(calibration, cloud, picture, self.in_picture), lifted(self.height_m)
        boxes, label = read_object_labels(self.root / LABELS / f"{stem}.txt")
        objects = files.objects(RecordedObjects(ids_of_frame(number, len(label)), boxes, label), world_SE3_lidar)
        agents = dict.fromkeys(self.agents, files.agent(world_SE3_lidar, self.height_m))
        return RecordedFrame(seconds_to_ns(number * self.frame_s), agents, objects)
