"""Cells and their results, as plain data. A cell is one policy in one condition with one seed."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from coopsim.geometry.se3 import Floats
from coopsim.support.checks import require_count, require_non_negative, require_number, require_probability


@dataclass(frozen=True, slots=True, order=True)
class Condition:
    """The disturbance of the agents; every policy in a condition meets the same traffic, noise and losses.

    Attributes:
        scenario: name of an environment, or path of a scenario file.
        latency_s: delay of every message.
        loss: probability that a message is lost on a link.
        position_noise_m: standard deviation of x and of y of the estimated pose.
        heading_noise_deg: standard deviation of its heading.
        bandwidth_bit_s: of the medium that all agents share; infinite: transmission takes no time.
    """

    scenario: str = "crossing"
    latency_s: float = 0.0
    loss: float = 0.0
    position_noise_m: float = 0.0
    heading_noise_deg: float = 0.0
    bandwidth_bit_s: float = math.inf

    def __post_init__(self) -> None:
        require_non_negative(
            latency_s=self.latency_s, position_noise_m=self.position_noise_m, heading_noise_deg=self.heading_noise_deg
        )
        require_probability(loss=self.loss)
        require_number("> 0 (inf: no limit)", lambda rate: rate > 0, bandwidth_bit_s=self.bandwidth_bit_s)


@dataclass(frozen=True, slots=True, order=True)
class Cell:
    """One run of a benchmark.

    Attributes:
        policy: as in `PolicySpec.text`: a name, or a name with parameters, `late_fusion(delayed=replay)`.
        condition: the disturbance of the agents.
        seed: decides everything in the run.
        frames: length of the run.
    """

    policy: str
    condition: Condition
    seed: int = 0
    frames: int = 100

    def __post_init__(self) -> None:
        require_count(0, seed=self.seed)
        require_count(1, frames=self.frames)


@dataclass(frozen=True, slots=True, eq=False)
class CellResult:
    """Result of a cell: only data that are the same in every run of it.

    Attributes:
        cell: the cell.
        values: mean over agents by metric (see `docs/reference/metrics.md`); empty for a failed cell.
        agents: values of each agent by metric.
        rewards: (F,) mean over agents, per frame.
        messages: number of messages sent, lost, ..., by the names of `ChannelCounts`.
        traceback: of the exception that made the cell fail; None for a finished cell.
        place_seed: seed of the drawn place that the run was in; None: the place is not drawn, or unknown.
        counts: what the policy counted, by name (`Policy.counts`).
        method: the method of a paper, or part of one, that the policy is (`Policy.method`).
        arithmetic: of networks in the run, see `coopsim.support.precision`; empty: unknown, or the cell failed.
    """

    cell: Cell
    values: Mapping[str, float] = field(default_factory=dict)
    agents: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    rewards: Floats = field(default_factory=lambda: np.zeros(0))
    messages: Mapping[str, int] = field(default_factory=dict)
    traceback: str | None = None
    place_seed: int | None = None
    counts: Mapping[str, int] = field(default_factory=dict)
    method: str = ""
    arithmetic: str = ""

    @property
    def failed(self) -> bool:
        """Whether the cell failed; it then has no values."""
        return self.traceback is not None

    @property
    def reason(self) -> str | None:
        """The traceback's last line; None for a finished cell."""
        return None if self.traceback is None else "".join(self.traceback.strip().splitlines()[-1:])
