"""Picture of a sweep before and after pasting."""

from __future__ import annotations

from pathlib import Path

from coopsim.learn.paste.paste import PastedFrame
from coopsim.viz.cloud_axes import draw_boxes, draw_cloud

_INCHES, _DOTS_PER_INCH = (16.0, 8.2), 110


def draw_pasted(path: Path, frame: PastedFrame, reach_m: float) -> Path:
    """Draw a sweep from above as it was, and with actors in it, with the boxes of both. Return the path of the PNG."""
    from matplotlib.figure import Figure

    figure = Figure(_INCHES, dpi=_DOTS_PER_INCH, layout="constrained")
    before, after = figure.subplots(1, 2)
    draw_cloud(before, frame.before, reach_m).set_title(f"before: {len(frame.before)} points")
    draw_cloud(after, frame.points, reach_m).set_title(f"after: {len(frame.points)} points")
    draw_boxes(after, frame.doubtful, "tab:gray", "doubtful: counts neither way")
    draw_boxes(after, frame.boxes, "tab:green", "pasted")
    if len(frame.boxes) + len(frame.doubtful):
        after.legend(loc="upper right", framealpha=0.8)
    figure.savefig(path)
    return path
