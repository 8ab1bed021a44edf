"""Posts: lamps, signs, traffic lights, bollards, hydrants, markers at the verge."""

from __future__ import annotations

import numpy as np

from coopsim.geometry import exact
from coopsim.geometry.se3 import Floats
from coopsim.world.furniture.materials import (
    DARK_METAL,
    RED,
    SIGN_BLUE,
    SIGN_RED,
    SIGN_WHITE,
    WHITE,
    YELLOW,
    ZINC,
)
from coopsim.world.furniture.piece import Piece, Shape, shape
from coopsim.world.furniture.solids import Solid, block, drum, post, prism

_X = np.array([1.0, 0.0, 0.0])
_SHEETS = (SIGN_RED, SIGN_BLUE, SIGN_WHITE, SIGN_RED)
_UNDER_PLATE_M = 2.2
"""Lower edge of a sign's plate over a pavement: 2.0 to 2.5 m are usual."""


def lamp(height_m: float, variant: int) -> Piece:
    """Build a lamp: a post, an arm ahead, and the head at its end."""
    arm = block((0.0, 1.5), (-0.04, 0.04), (height_m - 0.12, height_m))
    head = block((1.0, 1.8), (-0.15, 0.15), (height_m - 0.16, height_m - 0.02))
    return (shape(ZINC if variant % 2 else DARK_METAL, post(0.0, 0.0, (0.0, height_m), 0.1, 0.06), arm, head),)


def sign(height_m: float, variant: int) -> Piece:
    """Build a sign that looks ahead, round, square or triangular, on a post; its back is grey."""
    low_m = min(_UNDER_PLATE_M, height_m - 0.4)
    outline = _outline((8, 4, 4, 3)[variant % 4], low_m, height_m)
    board = prism(outline + _X * 0.03, outline + _X * 0.045)
    pole = block((-0.03, 0.03), (-0.03, 0.03), (0.0, height_m - 0.1))
    fan = np.arange(1, len(outline) - 1)
    front = Solid(outline + _X * 0.05, np.column_stack([np.zeros_like(fan), fan, fan + 1]))
    sheeting = Shape(front.vertices, front.faces, _SHEETS[variant % len(_SHEETS)], False, np.zeros((0, 7)))
    return shape(ZINC, pole, board), sheeting


def _outline(sides: int, low_m: float, high_m: float) -> Floats:
    """Return a regular outline (K, 3) m across x, between two heights, counter-clockwise from ahead."""
    turn = np.arange(sides) * 2 * np.pi / sides + (np.pi / 2 if sides == 3 else np.pi / sides)
    ring = np.stack([np.zeros(sides), exact.cos(turn), exact.sin(turn)], axis=1)
    scale = (high_m - low_m) / float(np.ptp(ring[:, 2]))
    ring *= scale
    ring[:, 2] += low_m - ring[:, 2].min()
    return ring


def traffic_light(height_m: float, _: int) -> Piece:
    """Build a traffic light that looks ahead."""
    head = block((0.05, 0.3), (-0.15, 0.15), (height_m - 0.95, height_m))
    return (shape(DARK_METAL, post(0.0, 0.0, (0.0, height_m), 0.055), head),)


def bollard(height_m: float, _: int) -> Piece:
    """Build a bollard with a ring that reflects."""
    ring = drum(0.0, 0.0, (height_m - 0.2, height_m - 0.1), 0.085)
    return shape(DARK_METAL, post(0.0, 0.0, (0.0, height_m), 0.075)), shape(SIGN_WHITE, ring)


def marker(height_m: float, _: int) -> Piece:
    """Build a marker post of a verge, with a plate that reflects ahead and back."""
    plate = block((-0.07, 0.07), (-0.03, 0.03), (height_m - 0.3, height_m - 0.12))
    return shape(WHITE, block((-0.06, 0.06), (-0.06, 0.06), (0.0, height_m))), shape(SIGN_WHITE, plate)


def hydrant(height_m: float, variant: int) -> Piece:
    """Build a hydrant with its outlets."""
    body = drum(0.0, 0.0, (0.0, 0.75 * height_m), 0.13)
    hood = drum(0.0, 0.0, (0.75 * height_m, height_m), 0.16, 0.07)
    outlets = block((-0.06, 0.06), (-0.22, 0.22), (0.5 * height_m, 0.65 * height_m))
    return (shape(RED if variant % 3 else YELLOW, body, hood, outlets),)
