"""A short episode to export, simulated once: two cars without cameras and a roadside unit whose camera looks down."""

from __future__ import annotations

from dataclasses import dataclass

import pytest

from coopsim.data.export.export_format import ExportFormat
from coopsim.data.export.export_frame import ExportFrame, ExportPlan, ExportSource
from coopsim.types import AgentSpec

SEED, FRAMES = 7, 6


@dataclass(frozen=True)
class ShortEpisode:
    """Frames, and what an export of them is given."""

    plan: ExportPlan
    agents: dict[str, AgentSpec]
    frames: tuple[ExportFrame, ...]

    def export(self, writer: ExportFormat, folder, frames: int = FRAMES, *, finish: bool = True) -> None:
        """Write the episode, or only the beginning of it."""
        writer.require(self.agents)
        writer.begin(folder, self.plan)
        writer.begin_episode(SEED)
        for frame in self.frames[:frames]:
            writer.write(frame)
        if finish:
            writer.end_episode()
            writer.end()


@pytest.fixture(scope="session")
def short_episode() -> ShortEpisode:
    options = {
        "connected_cars": 2,
        "rsus": 1,
        "vehicles": 12,
        "cameras": {"rsu": "front"},
        "position_noise_m": 0.5,
    }
    plan = ExportPlan("any", "crossing", (SEED,), FRAMES, options)
    source = ExportSource(plan, {})
    try:
        frames = tuple(source.episode(SEED))
        return ShortEpisode(plan, dict(source.agents), frames)
    finally:
        source.close()


@pytest.fixture
def folder_bytes():
    """A function that reads a folder as contents by relative path."""

    def read(folder) -> dict[str, bytes]:
        return {path.relative_to(folder).as_posix(): path.read_bytes() for path in folder.rglob("*") if path.is_file()}

    return read
