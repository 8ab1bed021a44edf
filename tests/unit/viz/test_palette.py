"""Colours that a reader can rely on."""

from __future__ import annotations

import numpy as np

from coopsim.viz import palette


def luminance(color: palette.RGB) -> float:
    """As the Web Content Accessibility Guidelines define it."""
    share = np.array(color) / 255
    linear = np.where(share <= 0.04045, share / 12.92, ((share + 0.055) / 1.055) ** 2.4)
    return float(linear @ [0.2126, 0.7152, 0.0722])


def test_neighbouring_ids_look_different() -> None:
    colors = np.array([palette.track_color(track_id) for track_id in range(200)])
    for apart in (1, 2):
        assert np.abs(colors[apart:] - colors[:-apart]).max(axis=1).min() > 60, f"ids that differ by {apart}"


def test_every_track_stands_out_from_the_road() -> None:
    road = luminance(palette.MAP["lanes"])
    contrast = [(luminance(palette.track_color(track_id)) + 0.05) / (road + 0.05) for track_id in range(200)]
    assert min(contrast) > 3  # what the guidelines ask of graphics


def test_colours_are_bytes_for_any_id() -> None:
    for track_id in (0, -7, 2**40, -(2**63)):
        assert all(0 <= channel <= 255 for channel in palette.track_color(track_id))
