"""Sweeps from above on matplotlib's axes: points and boxes, forward up."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.se3 import Floats
from coopsim.viz.bev import outlines

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_LOW_M, _HIGH_M = -0.5, 2.5  # heights between which points become brighter


def draw_cloud(axes: Axes, points: NDArray[Any], reach_m: float) -> Axes:
    """Draw points (N, 3 or more) m of a base frame, brighter with their height, up to `reach_m`. Return the axes."""
    axes.set(facecolor="black", aspect="equal", xlabel="to the right, m", ylabel="forward, m")
    axes.set(xlim=(-reach_m, reach_m), ylim=(-reach_m, reach_m))
    ordered = points[np.argsort(points[:, 2])]
    axes.scatter(
        -ordered[:, 1], ordered[:, 0], 0.4, ordered[:, 2], cmap="gray", vmin=_LOW_M, vmax=_HIGH_M, linewidths=0
    )
    return axes


def draw_boxes(axes: Axes, boxes: Floats, color: str, label: str) -> None:
    """Draw boxes (N, 7), each with a line from its middle to its front, and a label in the legend."""
    for number, box in enumerate(outlines(Boxes3D.from_array(boxes))):
        front, middle = (box[0] + box[3]) / 2, box.mean(axis=0)  # counter-clockwise from front left
        line = np.vstack([box, box[:1], [np.nan, np.nan], middle, front])
        axes.plot(-line[:, 1], line[:, 0], color=color, linewidth=1.1, label=label if number == 0 else None)
