"""Compare vehicles that react as drivers (`others="idm"`) with the log that they have left.

    python scripts/compare_drivers.py cologne8.fcd.xml.gz --radius-m 600

Nobody is connected: all vehicles that move in the log start as they do there, and drive by themselves. Printed are, for
the log and for the drivers: quantiles of speeds; of gaps to the leader within 50 m; of each vehicle's least
post-encroachment time up to 5 s where ways cross, and how many have one; vehicles that crashed; and how far drivers are
from where the log has them.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence

import numpy as np

from coopsim.data.logs.play.choice import Choice, Wish, choose
from coopsim.data.logs.play.drivers import Drivers
from coopsim.data.logs.reading import read_log
from coopsim.geometry.se3 import Floats
from coopsim.metrics.drive_events import FOLLOWING_RAD, LONGEST_S
from coopsim.metrics.encounters import least_delay

DT_S, LEADER_M = 0.1, 50.0
SHARES = (10, 50, 90)
NOBODY = np.zeros(0, np.int64)


def main(argv: Sequence[str] | None = None) -> None:
    """Compare the drivers of a log with it, and print a table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("log")
    parser.add_argument("--radius-m", type=float, default=250.0)
    parser.add_argument("--around", type=float, nargs=2, default=None)
    options = parser.parse_args(argv)
    log = read_log(options.log)
    around = tuple(options.around) if options.around else tuple(log.place[:, :2].mean(axis=0))
    wish = Wish(connected=0, start_s=log.start_s, around=around, radius_m=options.radius_m, least_s=1.0)
    choice = choose(log, wish, 0)
    drivers = Drivers(choice.log, choice.start_s, choice.log.size, NOBODY, np.zeros(0), NOBODY, idm=True)
    print(f"{len(drivers.track)} vehicles, {choice.end_s - choice.start_s:.0f} s")
    print("| | speed, m/s | gap, m | post-encroachment, s | crossed | crashed |")
    print("| -- | -- | -- | -- | -- | -- |")
    logged, driven = (bodies(choice, drivers, follow=follow) for follow in (True, False))
    for name, (boxes, speed), crashed in (("log", logged, 0), ("drivers", driven, len(drivers.crashed))):
        delays = encroachments_s(boxes)
        parts = (speed[np.isfinite(speed)], gaps_m(boxes), delays)
        columns = [
            ", ".join(f"{each:.1f}" for each in np.percentile(part, SHARES)) if len(part) else "" for part in parts
        ]
        print(f"| {name} | {' | '.join(columns)} | {len(delays)} | {crashed} |")
    apart = np.hypot(*(driven[0][:, :, :2] - logged[0][:, :, :2]).transpose(2, 0, 1))
    print("from where the log has them, m:", ", ".join(f"{each:.1f}" for each in np.nanpercentile(apart, SHARES)))


def bodies(choice: Choice, drivers: Drivers, *, follow: bool) -> tuple[Floats, Floats]:
    """Return bodies (F, A, 5) and speeds (F, A) of drivers' tracks (A,), in the log or as they drive; NaN: absent."""
    tracks, log = drivers.track, choice.log
    frames = round((choice.end_s - choice.start_s) / DT_S)
    boxes, speed = np.full((frames, len(tracks), 5), np.nan), np.full((frames, len(tracks)), np.nan)
    for frame in range(frames):
        now = log.at(choice.start_s + frame * DT_S) if follow else drivers.now
        of = np.isin(now.track, tracks)
        column = np.searchsorted(tracks, now.track[of])
        boxes[frame, column] = np.column_stack([now.place[of, :2], log.size[now.track[of], :2], now.heading[of]])
        speed[frame, column] = np.hypot(*now.velocity[of].T)
        if not follow:
            drivers.step(DT_S, {})
    return boxes, speed


def gaps_m(boxes: Floats) -> Floats:
    """Return the gaps (K,) m to leaders: the nearest bodies ahead that go the same way, in all frames."""
    found = []
    for frame in boxes:
        here = frame[np.isfinite(frame[:, 0])]
        step = here[None, :, :2] - here[:, None, :2]
        cos, sin = np.cos(here[:, 4])[:, None], np.sin(here[:, 4])[:, None]
        along, aside = step[..., 0] * cos + step[..., 1] * sin, step[..., 1] * cos - step[..., 0] * sin
        turned = np.abs((here[None, :, 4] - here[:, None, 4] + np.pi) % (2 * np.pi) - np.pi)
        ahead = (along > 0) & (np.abs(aside) < (here[:, None, 3] + here[None, :, 3]) / 2) & (turned < FOLLOWING_RAD)
        gap = np.where(ahead, along - (here[:, None, 2] + here[None, :, 2]) / 2, np.inf).min(axis=1, initial=np.inf)
        found.append(gap[gap < LEADER_M])
    return np.concatenate(found)


def encroachments_s(boxes: Floats) -> Floats:
    """Return the least post-encroachment times (K,) s of the vehicles that have one."""
    most = round(LONGEST_S / DT_S)
    found = []
    for k in range(boxes.shape[1]):
        others = np.ascontiguousarray(np.delete(boxes, k, axis=1))
        steps, _ = least_delay(np.ascontiguousarray(boxes[:, k]), others, most, FOLLOWING_RAD)
        found.append(max(steps - 1, 0) * DT_S if steps >= 0 else np.nan)
    delays = np.array(found)
    return delays[np.isfinite(delays)]


if __name__ == "__main__":
    main()
