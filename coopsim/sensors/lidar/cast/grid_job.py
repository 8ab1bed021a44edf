"""A sweep as a job that any number of threads share, of which none waits for another that has not come.

It falls into pieces, each with a ticket that whoever is free takes next: runs of parts to be set up, then bands of rows
to be drawn, then rows to be resolved. A piece waits only for pieces with lower tickets, which threads that are awake
have taken; and nothing here allocates or raises. So it ends, whoever helps, and who does what changes no bit.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from numba import njit

from coopsim.sensors.lidar.cast.atomics import Counters, add, raise_to, wait_for
from coopsim.sensors.lidar.cast.raster_kernel import LANES, Beams, Canvas, draw, resolve
from coopsim.sensors.lidar.cast.triangle_setup import Corners, Scene, Shapes, Singles, set_up
from coopsim.types import Ints

TICKETS, RUNS_SET_UP, ROWS_RESOLVED, BANDS_DRAWN = range(4)
"""What a job's progress counts; from the last on, each band has a counter."""

_SECTOR_SLACK_RAD = 1e-3
_AWAKE_US = 300
"""For how long to wait for another sweep: those of one turn, or of one sensor's diverging beams, come sooner."""


class Job(NamedTuple):
    """A sector to be swept.

    Attributes:
        scene: what there is.
        beams: the rays.
        blocks: of `LANES` columns, from the first to before the last.
        corners: room for the scene's.
        shapes: room for the scene's.
        canvas: room for the blocks.
        hits: as in `resolve`.
        pieces: numbers of runs and of bands: D.
        progress: (BANDS_DRAWN + D,) of 0.
    """

    scene: Scene
    beams: Beams
    blocks: tuple[int, int]
    corners: Corners
    shapes: Shapes
    canvas: Canvas
    hits: tuple[Singles, Ints, Singles]
    pieces: tuple[int, int]
    progress: Counters


@njit(cache=True, nogil=True, error_model="numpy")
def lead(job: Job, bell: Counters, number: int) -> None:
    """Ring for helpers that are awake, do a job with those that come, and return when it is done."""
    raise_to(bell, 0, number)
    _work(job)
    wait_for(job.progress, ROWS_RESOLVED, len(job.beams.tangent))


@njit(cache=True, nogil=True, error_model="numpy")
def follow(job: Job, bell: Counters, number: int) -> None:
    """Help with a job, then stay awake until the bell rings for a later one, or for a while."""
    _work(job)
    wait_for(bell, 0, number + 1, _AWAKE_US)


@njit(cache=True, nogil=True, error_model="numpy")
def _work(job: Job) -> None:
    """Do pieces until all have been begun."""
    scene, beams, blocks, shapes, progress = job.scene, job.beams, job.blocks, job.shapes, job.progress
    parts, rows, (runs, bands) = len(scene.parts.closed), len(beams.tangent), job.pieces
    height = -(-rows // bands)
    sector = _sector(beams, blocks)
    while True:
        ticket = add(progress, TICKETS, 1)
        band = ticket - runs
        n = band - bands
        if band < 0:
            run = parts * ticket // runs, parts * (ticket + 1) // runs
            set_up(scene, run, beams.tangent, sector, job.corners, shapes)
            add(progress, RUNS_SET_UP, 1)
        elif n < 0:
            wait_for(progress, RUNS_SET_UP, runs)
            draw(scene.parts.face_start, shapes, beams, blocks, (band, bands), job.canvas)
            add(progress, BANDS_DRAWN + band, 1)
        elif n < bands * height:
            band, row = n // height, n // height + n % height * bands  # the first band's rows first
            if row < rows:
                wait_for(progress, BANDS_DRAWN + band, 1)
                resolve(shapes, beams, row, blocks, job.canvas.owner, job.hits)
                add(progress, ROWS_RESOLVED, 1)
        else:
            return


@njit(cache=True, nogil=True, error_model="numpy")
def _sector(beams: Beams, blocks: tuple[int, int]) -> tuple[float, float]:
    """Azimuths of the rays in blocks of columns, rad: their middle, and how far they reach to either side."""
    step_rad = 2 * math.pi / beams.columns
    start = blocks[0] * LANES * step_rad + float(beams.shift_rad.min())
    end = blocks[1] * LANES * step_rad + float(beams.shift_rad.max())
    return (start + end) / 2, (end - start) / 2 + _SECTOR_SLACK_RAD
