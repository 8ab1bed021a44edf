"""What a benchmark varies: its axes, and how their values are called."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from coopsim.bench.cell import Condition


@dataclass(frozen=True, slots=True)
class Axis:
    """A number of a condition.

    Attributes:
        field: of `Condition`.
        title: for people.
        unit: in which it is shown.
        scale: from the field's unit to that one.
    """

    field: str
    title: str
    unit: str
    scale: float = 1.0

    def value(self, condition: Condition) -> float:
        """In the unit in which it is shown."""
        return float(getattr(condition, self.field)) * self.scale

    def text(self, condition: Condition) -> str:
        """Its value and unit."""
        value = self.value(condition)
        return f"{value:g} {self.unit}" if math.isfinite(value) else "no limit"

    def harm(self, value: float) -> float:
        """Larger where agents are worse off: less bandwidth, more of anything else."""
        return -value if self.field == "bandwidth_bit_s" else value


AXES = (
    Axis("latency_s", "latency", "ms", 1e3),
    Axis("loss", "loss", "%", 1e2),
    Axis("position_noise_m", "position noise", "m"),
    Axis("heading_noise_deg", "heading noise", "°"),
    Axis("bandwidth_bit_s", "bandwidth", "Mbit/s", 1e-6),
)


def varying_axes(conditions: Sequence[Condition]) -> tuple[Axis, ...]:
    """The axes on which the conditions differ."""
    return tuple(axis for axis in AXES if len({axis.value(each) for each in conditions}) > 1)


def label(condition: Condition, conditions: Sequence[Condition]) -> str:
    """A name for a condition among others: only what differs between them, or its scenario if nothing does."""
    scenarios = {each.scenario for each in conditions}
    axes = varying_axes(conditions)
    parts = [condition.scenario] if len(scenarios) > 1 or not axes else []
    return ", ".join([*parts, *(f"{axis.title} {axis.text(condition)}" for axis in axes)])


def mildest(conditions: Sequence[Condition]) -> tuple[Condition, ...]:
    """Those that are mildest on every axis at once, one per scenario; none where the grid has no such corner."""
    axes = varying_axes(conditions)
    least = [min((axis.value(each) for each in conditions), key=axis.harm) for axis in axes]
    return tuple(each for each in conditions if [axis.value(each) for axis in axes] == least)
