"""What a benchmark varies: its axes, and how their values are called."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

from coopsim.bench.grid.cell import Condition


@dataclass(frozen=True, slots=True)
class Axis:
    """A number of a condition.

    Attributes:
        field: of `Condition`.
        name: for people.
        unit: in which it is shown.
        scale: from the field's unit to that one.
        along: other axes of which each value belongs to one value of this, so that they vary together.
    """

    field: str
    name: str
    unit: str
    scale: float = 1.0
    along: tuple[Axis, ...] = ()

    @property
    def title(self) -> str:
        """Its name, and those of axes that vary along with it."""
        return " and ".join(axis.name for axis in (self, *self.along))

    @property
    def label(self) -> str:
        """Title with unit, to stand under a plot."""
        return f"{self.name} ({self.unit})" + "".join(f", with {axis.name}" for axis in self.along)

    def value(self, condition: Condition) -> float:
        """In the unit in which it is shown."""
        # 12 digits, since 0.07 * 100 is not 7.
        return float(f"{getattr(condition, self.field) * self.scale:.12g}")

    def text(self, condition: Condition) -> str:
        """Its value and unit, and those of axes that vary along with it."""
        values = [(axis, axis.value(condition)) for axis in (self, *self.along)]
        return " and ".join(f"{value:g} {axis.unit}" if math.isfinite(value) else "no limit" for axis, value in values)

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
    """The axes on which the conditions differ; those that only vary together are one."""
    return _varying(tuple(conditions))


@lru_cache(maxsize=8)
def _varying(conditions: tuple[Condition, ...]) -> tuple[Axis, ...]:
    axes: list[Axis] = []
    for axis in AXES:
        count = len({axis.value(each) for each in conditions})
        if count == 1:
            continue
        for k, other in enumerate(axes):
            pairs = {(other.value(each), axis.value(each)) for each in conditions}
            if len(pairs) == count == len({other.value(each) for each in conditions}):
                axes[k] = replace(other, along=(*other.along, axis))
                break
        else:
            axes.append(axis)
    return tuple(axes)


def label(condition: Condition, conditions: Sequence[Condition]) -> str:
    """A name for a condition among others: only what differs between them, or its scenario if nothing does."""
    return _joined(condition, conditions, [f"{axis.title} {axis.text(condition)}" for axis in varying_axes(conditions)])


def short_label(condition: Condition, conditions: Sequence[Condition]) -> str:
    """The same without the axes' titles; each has a unit of its own."""
    return _joined(condition, conditions, [axis.text(condition) for axis in varying_axes(conditions)])


def _joined(condition: Condition, conditions: Sequence[Condition], parts: Sequence[str]) -> str:
    several = len({each.scenario for each in conditions}) > 1
    return ", ".join([*([condition.scenario] if several or not parts else []), *parts])


def mildest_values(conditions: Sequence[Condition]) -> tuple[float, ...]:
    """The mildest value on each of the `varying_axes`."""
    return tuple(min((axis.value(each) for each in conditions), key=axis.harm) for axis in varying_axes(conditions))


def mildest(conditions: Sequence[Condition]) -> tuple[Condition, ...]:
    """Those that are mildest on every axis at once, one per scenario; none where the grid has no such corner."""
    axes, least = varying_axes(conditions), mildest_values(conditions)
    return tuple(each for each in conditions if tuple(axis.value(each) for axis in axes) == least)
