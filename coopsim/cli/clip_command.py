"""`coopsim clip`: a film of a pair of runs, without and with messages, for a talk."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from coopsim.cli.argument_types import count, policy
from coopsim.cli.arguments import Command, add_flags, add_options, add_unneeded, named_options, stored_results

if TYPE_CHECKING:
    from coopsim.bench.films.recording import Recording

_FIRST_SEEDS = tuple(range(1000, 1040))
"""Seeds that are tried where none is given: the first of those that results are made with."""


def _add_clip(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    add("of", metavar="FOLDER or SITUATION", help="of `coopsim bench`; or an environment, such as occluded_pedestrian")
    add("--out", type=Path, default=Path("clip.gif"), metavar="FILE", help=".gif or .mp4 (default: %(default)s)")
    add("--pair", type=count, default=1, metavar="N", help="number of the pair in the report of FOLDER (default: 1)")
    add("--seconds", type=count, default=30, help="length of the film (default: %(default)s)")
    add("--title", default="", help="default: situation and seed")
    add_flags(parser, "--all-grids")
    add_unneeded(parser, "--trust", "nothing is run any more")
    run = parser.add_argument_group("a situation", "runs it until one of the two crashes and the other does not")
    run.add_argument("--alone", type=policy, default="no_fusion", metavar="A", help="default: %(default)s")
    run.add_argument("--sharing", type=policy, default="late_fusion(delayed=replay)", metavar="B", help="%(default)s")
    add_flags(run, "--seeds", default=_FIRST_SEEDS, metavar="1000-1039", help="to try, in order")
    run.add_argument("--latency-ms", type=float, default=0.0, help="delay of every message (default: 0)")
    add_flags(run, "--device")
    add_options(run, "of the environment")


def _run_clip(options: argparse.Namespace) -> int:
    from tqdm import tqdm

    from coopsim.bench.safety.movie import FRAMES_PER_S, require_movie, write_movie
    from coopsim.bench.safety.pair_clip import PairClip

    require_movie(options.out)
    alone, sharing = _of_folder(options) if Path(options.of).is_dir() else _of_situation(options)
    clip = PairClip(alone, sharing, float(options.seconds), options.title)
    rate = FRAMES_PER_S[options.out.suffix.lower()]
    frames = tqdm(clip.frames(rate), "film", options.seconds * rate, disable=None, leave=False)
    write_movie(options.out, frames, rate)
    print(f"{sharing.cell.condition.scenario}, seed {sharing.cell.seed}: {alone.cell.policy}, {sharing.cell.policy}")
    print(f"written: {options.out}")
    return 0


def _of_folder(options: argparse.Namespace) -> tuple[Recording, Recording]:
    from coopsim.bench.films.choice import film_of
    from coopsim.bench.films.crash_pairs import find_pair
    from coopsim.bench.films.recording import Recording
    from coopsim.bench.results.result_table import ResultTable

    pair = find_pair(ResultTable.of(stored_results(Path(options.of), all_grids=options.all_grids)), options.pair)
    alone, sharing = (Recording.of(result.cell, film_of(result)) for result in (pair.alone, pair.sharing))
    return alone, sharing


def _of_situation(options: argparse.Namespace) -> tuple[Recording, Recording]:
    from tqdm import tqdm

    from coopsim.bench.grid.grid import Grid
    from coopsim.bench.search_pair import search_pair

    grid = Grid(
        (options.alone, options.sharing),
        device=options.device,
        scenarios=(options.of,),
        latencies_ms=(options.latency_ms,),
        seeds=options.seeds,
        frames=None,
        options=named_options(options),
    )
    return search_pair(grid, tqdm(grid.seeds, "seeds", disable=None, leave=False))


CLIP = Command(
    "film a pair of runs, without and with messages, side by side for a talk",
    _add_clip,
    _run_clip,
    ("coopsim clip occluded_pedestrian --out clip.gif", "coopsim clip coopsim-bench --pair 2 --out clip.mp4"),
)
