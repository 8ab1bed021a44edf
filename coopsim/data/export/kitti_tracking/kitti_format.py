"""KITTI's tracking benchmark: one sequence per episode and agent; docs/reference/export.md has every field."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path

from coopsim.data.export.export_format import EXPORT_FORMATS, ExportFormat, require_lidar
from coopsim.data.export.export_frame import ExportAgent, ExportFrame
from coopsim.data.export.export_plan import ExportPlan
from coopsim.data.export.kitti_tracking.kitti_checks import check_kitti
from coopsim.data.export.kitti_tracking.label_frame import LabelFrame, calibration_text, front_camera
from coopsim.data.export.kitti_tracking.label_lines import NOTHING_LABELLED, label_lines
from coopsim.data.export.kitti_tracking.oxts_lines import OxtsLines
from coopsim.data.export.line_file import LineFile
from coopsim.data.export.problem import Problem
from coopsim.data.files.float_points import encode_float_points
from coopsim.data.files.pictures import encode_png
from coopsim.errors import InvalidValueError
from coopsim.support.checks import require_choice
from coopsim.support.files import make_folder, write_whole, write_whole_bytes
from coopsim.types import AgentSpec

LABELLED = ("around", "picture")


class _Sequence:
    """The growing files of one agent's sequence."""

    def __init__(self, root: Path, name: str, column: int) -> None:
        self.name, self.column, self.oxts = name, column, OxtsLines(column)
        for kind in ("oxts", "label_02", "calib"):
            make_folder(root / kind)
        make_folder(root / "velodyne" / name)
        self.oxts_file, self.label_file = (
            LineFile(root / "oxts" / f"{name}.txt"),
            LineFile(root / "label_02" / f"{name}.txt"),
        )

    def close(self) -> None:
        self.oxts_file.close()
        self.label_file.close()


@EXPORT_FORMATS.register("kitti")
class KittiFormat(ExportFormat):
    """KITTI tracking: velodyne, image_02, calib, oxts and label_02.

    Args:
        agent: name of the only agent to export; None: all, a sequence each.
        lidar: name of the LiDAR whose points are written; None: the first of each agent.
        camera: name of the camera of `image_02`; None: the one that looks most ahead.
        labels: "around" labels all objects that the agent's LiDARs hit; "picture" those of them that the camera shows,
            as KITTI does.
    """

    def __init__(
        self, agent: str | None = None, lidar: str | None = None, camera: str | None = None, labels: str = "around"
    ) -> None:
        require_choice("labels", labels, LABELLED)
        self._agent, self._lidar, self._camera, self._labels = agent, lidar, camera, labels

    def require(self, agents: Mapping[str, AgentSpec]) -> None:
        if self._agent is not None:
            require_choice("agent", self._agent, agents)
        self._kinds = {name: each.kind for name, each in agents.items() if self._agent in (None, name)}
        for name in self._kinds:
            require_lidar(name, agents[name], self._lidar)
            if self._camera is not None:
                require_choice("camera", self._camera, agents[name].cameras, f"of {name}")
            for camera, calibration in agents[name].cameras.items():
                if calibration.distortion.any():
                    raise InvalidValueError(
                        f"pictures must be without distortion in this format, {camera} of {name} has some"
                    )

    def begin(self, folder: Path, plan: ExportPlan) -> None:
        self._root, self._plan = folder / "training", plan

    def begin_episode(self, seed: int) -> None:
        self._seed = seed
        self._sequences: list[_Sequence] = []

    def write(self, frame: ExportFrame) -> None:
        if frame.index == 0:
            columns = [number for number, each in enumerate(frame.agents) if each.name in self._kinds]
            names = self._sequence_names()
            self._sequences = [
                _Sequence(self._root, names[self._seed, frame.agents[column].name], column) for column in columns
            ]
        for sequence in self._sequences:
            self._write_agent(frame, frame.agents[sequence.column], sequence)

    def end_episode(self) -> None:
        for sequence in self._sequences:
            sequence.close()

    def end(self) -> None:
        last = self._plan.frames
        names = self._sequence_names()
        write_whole(
            self._root / "evaluate_tracking.seqmap.training",
            "".join(f"{name} empty 000000 {last:06d}\n" for name in names.values()),
        )
        lines = [
            f"{name},{self._plan.episode_name(seed)},{agent},{self._kinds[agent]}\n"
            for (seed, agent), name in names.items()
        ]
        write_whole(self._root / "sequences.csv", "".join(["sequence,episode,agent,kind\n", *lines]))

    def check(self, folder: Path) -> Iterator[Problem]:
        return check_kitti(folder)

    def _sequence_names(self) -> dict[tuple[int, str], str]:
        """Return the number of each sequence as four digits, by seed and agent."""
        pairs = [(seed, agent) for seed in self._plan.seeds for agent in self._kinds]
        return {pair: f"{number:04d}" for number, pair in enumerate(pairs)}

    def _write_agent(self, frame: ExportFrame, agent: ExportAgent, sequence: _Sequence) -> None:
        scan = agent.scan(self._lidar)
        camera = front_camera(agent, self._camera)
        shot = None if camera is None else agent.cameras[camera]
        labels = LabelFrame.of(scan, None if shot is None else shot.calibration)
        if frame.index == 0:
            write_whole(self._root / "calib" / f"{sequence.name}.txt", calibration_text(labels, scan))
        points = self._root / "velodyne" / sequence.name / f"{frame.index:06d}.bin"
        write_whole_bytes(points, encode_float_points(scan.points, scan.intensity))
        if shot is not None and shot.image.rgb is not None:
            folder = self._root / "image_02" / sequence.name
            make_folder(folder)
            write_whole_bytes(folder / f"{frame.index:06d}.png", encode_png(shot.image.rgb))
        sequence.oxts_file.append(sequence.oxts.line(frame))
        lines = label_lines(frame, sequence.column, labels, only_in_picture=self._labels == "picture")
        if not lines and frame.index == self._plan.frames - 1:
            lines = [NOTHING_LABELLED.format(frame=frame.index)]
        sequence.label_file.append(*lines)
