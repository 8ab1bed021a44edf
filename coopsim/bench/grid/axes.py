"""The axes on which a benchmark varies conditions, and labels for their values."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

from coopsim.bench.grid.cell import Condition


@dataclass(frozen=True, slots=True)
class Axis:
    """A number of a condition, with its labels.

    Attributes:
        field: of `Condition`.
        name: in labels.
        unit: in labels.
        scale: factor from the field's unit to the shown one.
        along: other axes that vary together with this one: each of their values belongs to one value of this.
    """

    field: str
    name: str
    unit: str
    scale: float = 1.0
    along: tuple[Axis, ...] = ()

    @property
    def title(self) -> str:
        """The name, with the names of axes that vary along."""
        return " and ".join(axis.name for axis in (self, *self.along))

    @property
    def label(self) -> str:
        """The title with its unit, for plots."""
        return f"{self.name} ({self.unit})" + "".join(f", with {axis.name}" for axis in self.along)

    def value(self, condition: Condition) -> float:
        """Return the condition's value in the shown unit."""
        # 12 digits, because 0.07 * 100 is not 7.
        return float(f"{getattr(condition, self.field) * self.scale:.12g}")

    def text(self, condition: Condition) -> str:
        """Format the condition's value with its unit, and those of axes that vary along."""
        values = [(axis, axis.value(condition)) for axis in (self, *self.along)]
        return " and ".join(f"{value:g} {axis.unit}" if math.isfinite(value) else "no limit" for axis, value in values)

    def harm(self, value: float) -> float:
        """Return a number that rises with the harm of a value: less bandwidth, more of anything else."""
        return -value if self.field == "bandwidth_bit_s" else value


AXES = (
    Axis("latency_s", "latency", "ms", 1e3),
    Axis("loss", "loss", "%", 1e2),
    Axis("position_noise_m", "position noise", "m"),
    Axis("heading_noise_deg", "heading noise", "°"),
    Axis("bandwidth_bit_s", "bandwidth", "Mbit/s", 1e-6),
)


def varying_axes(conditions: Sequence[Condition]) -> tuple[Axis, ...]:
    """Return the axes on which conditions differ; axes that only vary together are one."""
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
    """Name a condition among others by what differs between them, or by its scenario if nothing does."""
    return _joined(condition, conditions, [f"{axis.title} {axis.text(condition)}" for axis in varying_axes(conditions)])


def short_label(condition: Condition, conditions: Sequence[Condition]) -> str:
    """Name a condition as `label` does, without the axes' titles."""
    return _joined(condition, conditions, [axis.text(condition) for axis in varying_axes(conditions)])


def _joined(condition: Condition, conditions: Sequence[Condition], parts: Sequence[str]) -> str:
    several = len({each.scenario for each in conditions}) > 1
    return ", ".join([*([condition.scenario] if several or not parts else []), *parts])


def mildest_values(conditions: Sequence[Condition]) -> tuple[float, ...]:
    """Return the mildest value on each of the `varying_axes`."""
    return tuple(min((axis.value(each) for each in conditions), key=axis.harm) for axis in varying_axes(conditions))


def mildest(conditions: Sequence[Condition]) -> tuple[Condition, ...]:
    """Return the conditions that are mildest on every axis, at most one per scenario; a grid may lack that corner."""
    axes, least = varying_axes(conditions), mildest_values(conditions)
    return tuple(each for each in conditions if tuple(axis.value(each) for axis in axes) == least)
