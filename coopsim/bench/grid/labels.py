"""Names of conditions among others: by the axes on which they differ, and which of them disturb least."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache

from coopsim.bench.grid.axis import USUAL, Axis, axis_of
from coopsim.bench.grid.cell import Cell, Condition, further_options


def axes_of(conditions: Sequence[Condition]) -> tuple[Axis, ...]:
    """Return the axes on which conditions have a value: those of `AXES`, then further options by name."""
    return _axes(tuple(conditions))


@lru_cache(maxsize=8)
def _axes(conditions: tuple[Condition, ...]) -> tuple[Axis, ...]:
    known = [option for option in USUAL if any(each.get(option) is not None for each in conditions)]
    options = *known, *further_options(conditions)
    return tuple(axis_of(option, [each.get(option) for each in conditions]) for option in options)


def varying_axes(conditions: Sequence[Condition]) -> tuple[Axis, ...]:
    """Return the axes on which conditions differ; axes that only vary together are one."""
    return _varying(tuple(conditions))


@lru_cache(maxsize=8)
def _varying(conditions: tuple[Condition, ...]) -> tuple[Axis, ...]:
    axes: list[Axis] = []
    for axis in _axes(conditions):
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


def values_of(axis: Axis, conditions: Sequence[Condition]) -> dict[float | str, str]:
    """Return the values of an axis with their texts: numbers rise; names are by their texts, after that of none."""
    texts = {axis.value(each): axis.text(each) for each in conditions}
    return dict(sorted(texts.items(), key=lambda each: axis.harm(each[0]) if axis.named else each))


def label(condition: Condition, conditions: Sequence[Condition]) -> str:
    """Name a condition among others by what differs between them, or by its scenario if nothing does."""
    return _joined(condition, conditions, [axis.phrase(condition) for axis in varying_axes(conditions)])


def short_label(condition: Condition, conditions: Sequence[Condition]) -> str:
    """Name a condition as `label` does, without the axes' titles where units tell which they are."""
    axes = varying_axes(conditions)
    short = [axis.text(condition) if axis.unit or axis.option in USUAL else axis.phrase(condition) for axis in axes]
    return _joined(condition, conditions, short)


def _joined(condition: Condition, conditions: Sequence[Condition], parts: Sequence[str]) -> str:
    several = len({each.scenario for each in conditions}) > 1
    return ", ".join([*([condition.scenario] if several or not parts else []), *parts])


def mildest(conditions: Sequence[Condition]) -> tuple[Condition, ...]:
    """Return the conditions that are mildest on every axis, at most one per scenario; a grid may lack that corner."""
    return tuple(conditions[k] for k in mildest_along(None, conditions))


def mildest_along(axis: Axis | None, conditions: Sequence[Condition]) -> list[int]:
    """Return the numbers of the conditions that are mildest on every axis but one."""
    others = tuple(each for each in varying_axes(conditions) if each != axis)
    return [k for k, count in enumerate(_disturbed(tuple(conditions), others)) if not count]


def disturbances(conditions: Sequence[Condition]) -> list[int]:
    """Return the number of axes on which each condition is not at the mildest value."""
    return list(_disturbed(tuple(conditions), varying_axes(conditions)))


@lru_cache(maxsize=32)
def _disturbed(conditions: tuple[Condition, ...], axes: tuple[Axis, ...]) -> tuple[int, ...]:
    least = [min((each.value(condition) for condition in conditions), key=each.harm) for each in axes]
    return tuple(sum(each.value(one) != value for each, value in zip(axes, least, strict=True)) for one in conditions)


def name_of_cell(cell: Cell, conditions: Sequence[Condition]) -> str:
    """Name a cell among those of some conditions."""
    return f"{cell.policy}, {label(cell.condition, conditions)}, seed {cell.seed}"
