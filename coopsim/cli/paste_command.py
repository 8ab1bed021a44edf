"""`coopsim paste`."""

from __future__ import annotations

import argparse
from pathlib import Path

from coopsim.cli.argument_types import accepting, count, count_or_zero
from coopsim.cli.arguments import Command, add_flags


@accepting("a count or two, as 4-12")
def _between(text: str) -> tuple[int, int]:
    """Return the ends of a range of counts, such as 4-12; one count is both."""
    low, _, high = text.partition("-")
    if not (low.isdecimal() and (high or low).isdecimal()):
        raise ValueError
    return int(low), int(high or low)


def _add_paste(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    of = "folder of sweeps: of a data set, or of plain arrays (labels unread)"
    add("sweeps", type=Path, metavar="SWEEPS", help=of)
    add("--out", type=Path, required=True, metavar="FOLDER", help="empty or new: for labelled frames and a picture")
    add("--actors", type=_between, default=(4, 12), metavar="4-12", help="drawn for a sweep (default: 4-12)")
    add("--reach-m", type=float, default=50.0, help="farthest place of an actor (default: %(default)g)")
    add("--frames", type=count, default=1, help="consecutive sweeps with the same actors (default: 1)")
    add("--copies", type=count, default=1, help="how often each sweep is used, with other actors (default: 1)")
    of = "finds what is there, by name or path (default: pillars)"
    add_flags(parser, "--detector", default="pillars", metavar="WEIGHTS", help=of)
    add("--doubt", type=float, default=0.15, metavar="SCORE", help="from which a place is doubtful (default: 0.15)")
    add("--lidar-height-m", type=float, help="of the LiDAR over the ground, where files do not say it")
    add("--seed", type=count_or_zero, default=0, help="of all that is drawn (default: 0)")
    add_flags(parser, "--device")


def _run_paste(options: argparse.Namespace) -> int:
    from tqdm import tqdm

    import coopsim.nn  # noqa: F401  (says how to install torch, where it is not)
    from coopsim.learn.paste.object_finder import ObjectFinder
    from coopsim.learn.paste.paste import PasteSettings, paste
    from coopsim.learn.paste.picture import draw_pasted

    settings = PasteSettings(
        actors=options.actors,
        reach_m=options.reach_m,
        frames=options.frames,
        copies=options.copies,
        seed=options.seed,
        lidar_height_m=options.lidar_height_m,
    )
    doubts = ObjectFinder(options.detector, options.doubt, options.device)
    pasted = paste(options.sweeps, options.out, settings, doubts)
    frames = actors = 0
    picture = options.out / "paste.png"
    for frame in tqdm(pasted, "frames", disable=None, leave=False):
        if frames == 0:
            draw_pasted(picture, frame, settings.reach_m)
        frames, actors = frames + 1, actors + len(frame.boxes)
    print(f"{actors} actors in {frames} frames")
    print(f"written: {options.out}")
    print(f"written: {picture}")
    return 0


PASTE = Command(
    "paste simulated actors into sweeps without labels; the result is labelled, and trains beside towns",
    _add_paste,
    _run_paste,
    (
        "coopsim paste path/to/sweeps --out pasted",
        "coopsim train pillars town pasted --out mine",
    ),
)
