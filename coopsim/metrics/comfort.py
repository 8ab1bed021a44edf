"""Comfort of a drive by nuPlan's six bounds, which NAVSIM takes over (`ego_is_comfortable` of both)."""

from __future__ import annotations

import numpy as np

from coopsim.geometry.se3 import Floats
from coopsim.types import Mask

LON_M_S2, LAT_M_S2 = (-4.05, 2.40), 4.89
"""Bounds of acceleration along and across the road."""

LON_JERK_M_S3, JERK_M_S3 = 4.13, 8.37
"""Bounds of jerk along the road, and of that of the magnitude of acceleration."""

YAW_RATE_RAD_S, YAW_ACCELERATION_RAD_S2 = 0.95, 1.93
"""Bounds of how fast the car turns, and of the change of that."""

_SMOOTH_S, _JERK_S, _YAW_S = 0.8, 1.5, 0.5
"""Windows of the filters: nuPlan's of 8, 15 and 5 frames of 0.1 s."""


def uncomfortable(acceleration_m_s2: Floats, speed_m_s: Floats, heading_rad: Floats, dt_s: float) -> Mask:
    """Return the mask (F,) of frames in which at least one of the bounds is not kept.

    Args:
        acceleration_m_s2: (F,) along the heading.
        speed_m_s: (F,) along the heading.
        heading_rad: (F,).
        dt_s: time between two frames.
    """
    heading = np.unwrap(heading_rad)
    turns = np.gradient(heading, dt_s) if len(heading) > 1 else np.zeros(len(heading))
    across = np.abs(speed_m_s * turns)
    along = _filtered(acceleration_m_s2, _SMOOTH_S, dt_s)
    magnitude = _filtered(np.hypot(acceleration_m_s2, across), _SMOOTH_S, dt_s)
    across = _filtered(across, _SMOOTH_S, dt_s)
    beyond: Mask = (along <= LON_M_S2[0]) | (along >= LON_M_S2[1]) | (np.abs(across) >= LAT_M_S2)
    beyond |= np.abs(_filtered(along, _JERK_S, dt_s, slope=1)) >= LON_JERK_M_S3
    beyond |= np.abs(_filtered(magnitude, _JERK_S, dt_s, slope=1)) >= JERK_M_S3
    beyond |= np.abs(_filtered(heading, _YAW_S, dt_s, slope=1)) >= YAW_RATE_RAD_S
    beyond |= np.abs(_filtered(heading, _YAW_S, dt_s, slope=2, order=3)) >= YAW_ACCELERATION_RAD_S2
    return beyond


def _filtered(values: Floats, window_s: float, dt_s: float, slope: int = 0, order: int = 2) -> Floats:
    """Return values (F,), or a slope of them, through a Savitzky-Golay filter; too few have no slope."""
    from scipy.signal import savgol_filter  # takes half a second

    window = min(max(round(window_s / dt_s), order + 1), len(values))
    if window <= order:
        return values if slope == 0 else np.zeros(len(values))
    return np.asarray(savgol_filter(values, window, order, deriv=slope, delta=dt_s), np.float64)
