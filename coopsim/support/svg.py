"""Charts as SVG, drawn by matplotlib, which is loaded when the first is drawn."""

from __future__ import annotations

import io
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def to_svg(draw: Callable[[Figure], object], width_in: float, height_in: float) -> str:
    """Return as SVG what a function draws on a matplotlib figure of a size in inches.

    Text stays text, and the same drawing gives the same bytes.
    """
    from matplotlib import rc_context
    from matplotlib.figure import Figure

    text = io.StringIO()
    # No date and no random ids: the same numbers give the same file.
    with rc_context({"svg.hashsalt": "coopsim", "svg.fonttype": "none", "font.size": 9, "text.parse_math": False}):
        figure = Figure(figsize=(width_in, height_in), layout="constrained")
        draw(figure)
        figure.savefig(text, format="svg", metadata={"Date": None, "Creator": "coopsim"})
    return text.getvalue()


def line_style(number: int) -> tuple[str, str]:
    """Return matplotlib's style and colour of line `number`; the first 30 lines all look different."""
    return ("-", "--", ":")[number // 10 % 3], f"C{number % 10}"


_LEVEL_LETTERS = 14
"""Most letters of a name that is written level on an axis."""


def name_ticks(panel: Any, names: Sequence[str]) -> None:
    """Put names at 0, 1, 2, ... of a panel's horizontal axis: level, or slanted where they would overlap."""
    slanted = len(names) > 1 and max(map(len, names)) > _LEVEL_LETTERS
    look = {"rotation": 20, "ha": "right", "rotation_mode": "anchor"} if slanted else {}
    panel.set_xticks(range(len(names)), names, **look)
    panel.set_xlim(-0.5, len(names) - 0.5)
