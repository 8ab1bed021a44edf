r"""Measure detectors on labelled real sweeps, fine-tune them on few, and remake the page's tables and pictures.

    python scripts/measure_real_sweeps.py ~/real --frames kitti_000000,kitti_000001,kitti_000002,av2_7fab_0 \
        --page docs/results/real_sweeps.md
    python scripts/measure_real_sweeps.py ~/real --frames ... --page docs/results/real_sweeps.md --curve

The folder has plain arrays, a frame a file, as docs/reference/replay.md describes. Without `--curve` the shipped
detector is measured: the page's tables by range and class, and a picture of each frame. With it, detectors are trained
on some of the frames, from shipped weights, alone or beside drawn towns, and from nothing. Each is measured on a frame
that it was not trained on: every frame is held out once, and the hits of all are ranked together.
"""

from __future__ import annotations

import argparse
import json
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from tabulate import tabulate

from coopsim.bench.detect.detect import Measured, measure_detection, metrics_of
from coopsim.bench.detect.detect_plan import DetectPlan
from coopsim.bench.detect.perceived import Perceived
from coopsim.bench.detect.protocols import PROTOCOLS
from coopsim.bench.detect.range_table import range_table
from coopsim.bench.detect.sweep_pictures import draw_measured
from coopsim.bench.engine.engine import Engine
from coopsim.cli.argument_types import count, names, numbers
from coopsim.support.files import write_whole

PROTOCOL, WITHIN_M = "coopsim", 50.0
OPTIONS = {"ground_truth": "visible", "region_x_m": WITHIN_M, "region_y_m": WITHIN_M}
SHOWN = ("APBEV@0.3", "APBEV@0.5", "APBEV@0.7", "APBEV@0.3 people", "APBEV@0.3 riders")

SHIPPED, BESIDE_TOWNS, NOTHING = TRAININGS = ("shipped", "shipped, beside towns", "nothing")
"""Weights that a training begins with, and whether half of its clips are of drawn towns."""

SHIPPED_RATE, FIRST_RATE = 5e-4, 2e-3
"""Highest learning rates from shipped weights and from nothing; the latter is the recipe's."""


@dataclass(frozen=True)
class Tuning:
    """Trainings on few frames.

    Attributes:
        detector: recipe and shipped weights.
        counts: numbers of real frames.
        steps: steps of the optimizer from shipped weights.
        first_steps: steps from nothing.
    """

    detector: str
    counts: Sequence[int]
    steps: int
    first_steps: int

    def train(self, folder: str, title: str, out: Path) -> Path:
        """Train on all frames of a folder, as one of `TRAININGS`; return the path of the weights."""
        from coopsim.learn.recipe import find_recipe
        from coopsim.learn.train import train

        start = None if title == NOTHING else self.detector
        recipe = find_recipe(self.detector).changed(
            start=start,
            steps=self.steps if start else self.first_steps,
            lr=SHIPPED_RATE if start else FIRST_RATE,
            batch=2,
            block=4,
            world={"environments": ["town", folder] if title == BESIDE_TOWNS else [folder], "frames": 1},
        )
        return train(recipe, out, workers=0)

    def curve(self, frames: Sequence[Path], keep: Path) -> Iterator[dict[str, Any]]:
        """Yield a row for each number of frames and each start; finished ones are read from the folder `keep`."""
        yield _row(SHIPPED, 0, dict.fromkeys(frames, with_weights(self.detector)), keep)
        for title in TRAININGS:
            for number in self.counts:
                done = keep / f"{_file_name(title)}-{number}.json"
                if not done.is_file():
                    made = {frame: self._weights(frames, frame, number, title, keep) for frame in frames}
                    found = {frame: with_weights(path) for frame, path in made.items()}
                    write_whole(done, json.dumps(_row(title, number, found, keep)))
                yield json.loads(done.read_text())

    def _weights(self, frames: Sequence[Path], held_out: Path, number: int, title: str, keep: Path) -> Path:
        others = [frame for frame in frames if frame != held_out]
        rng = np.random.default_rng(frames.index(held_out))
        chosen = [others[k] for k in rng.permutation(len(others))[:number]]  # fewer are a part of more
        return self.train(linked(chosen, keep), title, keep / f"{held_out.stem}-{number}-{_file_name(title)}")


def _file_name(title: str) -> str:
    return re.sub(r"\W+", "_", title)


def linked(frames: Sequence[Path], keep: Path) -> str:
    """Return a folder of links to some frames, the same for the same frames, so that trainings go on."""
    folder = keep / "links" / "-".join(sorted(frame.stem for frame in frames))
    folder.mkdir(parents=True, exist_ok=True)
    for frame in frames:
        link = folder / frame.name
        link.unlink(missing_ok=True)
        link.symlink_to(frame.resolve())
    return str(folder)


def with_weights(weights: str | Path) -> str:
    """Return the spec of the detector with these weights, by name or path."""
    return f"pillars(weights={str(weights)!r})"


def plan_of(folder: str | Path, detector: str, sequences: int = 1) -> DetectPlan:
    """Return the plan of a measurement of all frames in a folder."""
    return DetectPlan(
        policies=("no_fusion",),
        environments=(str(folder),),
        seeds=tuple(range(sequences)),
        frames=10_000,
        detector=detector,
        protocol=PROTOCOL,
        within_m=WITHIN_M,
        options=OPTIONS,
    )


def _row(start: str, number: int, detectors: Mapping[Path, str], keep: Path) -> dict[str, Any]:
    """Measure each frame by its detector, and rank the detections of all together."""
    parts = []
    for frame, detector in detectors.items():
        folder = linked([frame], keep)
        (job,) = plan_of(folder, detector).jobs()
        result = job.run().result
        if result.failed:
            raise SystemExit(result.traceback)
        parts.append(Measured.of(Perceived.from_arrays(result.arrays), PROTOCOL, WITHIN_M).rankings)
    values = metrics_of(PROTOCOLS.get(PROTOCOL)(), parts)
    return {"start": start, "frames": number, **{name: values[name] for name in SHOWN}}


def curve_table(rows: Iterable[Mapping[str, Any]]) -> str:
    """Format the curve as a Markdown table."""
    header = ["from", "real frames", *(name.removeprefix("APBEV@") for name in SHOWN)]
    lines = [[row["start"], row["frames"], *(f"{row[name] or 0.0:.2f}" for name in SHOWN)] for row in rows]
    align = ["left", *["right"] * (len(header) - 1)]
    return tabulate(lines, headers=header, tablefmt="github", colalign=align, disable_numparse=True)


def replace_block(page: Path, name: str, text: str) -> None:
    """Replace the part of a page between `<!-- NAME -->` and `<!-- end of NAME -->`."""
    content = page.read_text(encoding="utf-8")
    pattern = re.compile(rf"(<!-- {name} -->\n).*?(\n<!-- end of {name} -->)", re.DOTALL)
    if not pattern.search(content):
        raise SystemExit(f"{page} has no block {name}")
    write_whole(page, pattern.sub(lambda match: f"{match[1]}\n{text}\n{match[2]}", content))


def measure_shipped(frames: Sequence[Path], detector: str, keep: Path, pictures: Path) -> str:
    """Measure a detector on frames and draw them; return the table by range and class."""
    from coopsim.recordings.formats import open_folder

    folder = linked(frames, keep)
    plan = plan_of(folder, detector, len(open_folder(folder).sequences))
    (row,) = measure_detection(plan, folder=keep / "episodes", engine=Engine(workers=1))
    for path in draw_measured(plan, keep / "episodes", pictures):
        path.replace(path.with_name(f"{path.name.rpartition('-cav_0')[0]}.png"))
    return range_table(row).partition("\n\n")[2]


def main() -> None:
    """Run the command."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--frames", type=names, required=True, help="names of files, without .npz")
    parser.add_argument("--page", type=Path, help="whose tables and pictures are remade; else they are printed")
    parser.add_argument("--detector", default="pillars", help="recipe and shipped weights (default: %(default)s)")
    parser.add_argument("--curve", action="store_true", help="train on few frames, too")
    parser.add_argument("--counts", type=numbers, default=(1, 3), help="of real frames (default: 1,3)")
    parser.add_argument("--steps", type=count, default=80, help="from shipped weights (default: %(default)s)")
    parser.add_argument("--first-steps", type=count, default=240, help="from nothing (default: %(default)s)")
    parser.add_argument("--keep", type=Path, default=Path("build/real_sweeps"), help="of trainings")
    options = parser.parse_args()
    frames = [options.folder / f"{name}.npz" for name in options.frames]
    if missing := [str(frame) for frame in frames if not frame.is_file()]:
        parser.error(f"no file {', '.join(missing)}")
    pictures = options.page.with_suffix("") if options.page else options.keep / "pictures"
    made = {"shipped": measure_shipped(frames, with_weights(options.detector), options.keep, pictures)}
    if options.curve:
        tuning = Tuning(options.detector, [int(each) for each in options.counts], options.steps, options.first_steps)
        made["curve"] = curve_table(tuning.curve(frames, options.keep))
    for name, text in made.items():
        if options.page:
            replace_block(options.page, name, text)
        else:
            print(f"{text}\n")


if __name__ == "__main__":
    main()
