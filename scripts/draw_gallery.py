"""Draw the pictures of the documentation again: run the commands of some steps, or list all.

    python scripts/draw_gallery.py --list
    python scripts/draw_gallery.py [STEP ...] [--without STEP ...]

A step is a few commands that write pictures into the folders of `docs/`. Steps that need a browser take that of
`picture_pages.py`; those that need recordings or maps take them from COOPSIM_DATA, and are left out without it if no
step is named. The pictures in `OTHERS` are drawn by other programs, or by hand.
"""

from __future__ import annotations

import argparse
import os
import re
import shlex
import subprocess
import sys
import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"

_SHOT, _FILM = "python scripts/picture_pages.py shot {tmp}", "python scripts/picture_pages.py film {tmp}"
_LITTLE = "--latencies-ms 0 --losses 0 --position-noises-m 0 --heading-noises-deg 0"


@dataclass(frozen=True)
class Step:
    """Commands that draw pictures.

    Attributes:
        pictures: what they write, from `docs/` on; patterns as of `Path.glob`.
        commands: shell words, run in the root of the repository; `{tmp}` is a temporary folder, `{data}` COOPSIM_DATA.
    """

    pictures: tuple[str, ...]
    commands: tuple[str, ...]

    @property
    def needs_data(self) -> bool:
        """It reads recordings or maps."""
        return any("{data}" in command for command in self.commands)


def _drawn(kind: str, *pictures: str, data: bool = False) -> Step:
    """Return a step of `draw_pictures.py`."""
    return Step(pictures, (f"{'env COOPSIM_DATA={data} ' * data}python scripts/draw_pictures.py {kind}",))


STEPS: Mapping[str, Step] = {
    "street": Step(
        ("gallery/street.webp", "gallery/seat.png"),
        (
            "coopsim demo --frames 44 --connected-cars 3 --latencies-ms 0 --seed 7 --out {tmp}/street.html",
            f"{_FILM}/street.html docs/gallery/street.webp --dark --size 680x700 --first 2 --last 40",
            f"{_SHOT}/street.html docs/gallery/seat.png --hash 't=2&view=seat' --of .space-stage",
        ),
    ),
    "demo": Step(
        ("gallery/demo.png",),
        ("coopsim demo --out {tmp}/demo.html", f"{_SHOT}/demo.html docs/gallery/demo.png --hash t=4 --size 1200x1700"),
    ),
    "bench": Step(
        ("gallery/bench.png", "gallery/pair.png"),
        (
            "coopsim bench --preset safety --environments occluded_pedestrian,crossing_path --penetrations 0.5"
            " --policies 'no_fusion,late_fusion(delayed=replay)' --seeds 1000-1009 --clips 4 --film-3d"
            f" {_LITTLE} --out {{tmp}}/bench",
            f"{_SHOT}/bench/report.html docs/gallery/bench.png --size 1200x900",
            f"{_SHOT}/bench/report.html docs/gallery/pair.png --of .space-stage",
        ),
    ),
    "clip": Step(
        ("gallery/crash_avoided.gif",),
        ("coopsim clip occluded_pedestrian --seconds 12 --out docs/gallery/crash_avoided.gif",),
    ),
    "sweeps": Step(("gallery/sweeps.png",), ("page gallery/sensors.md",)),
    "maps": _drawn("maps", "gallery/maps.jpg", data=True),
    "scenarios": _drawn("scenarios", "reference/scenarios/*.png"),
    "situations": _drawn("situations", "reference/situations.png"),
    "furniture": _drawn("furniture", "reference/furniture.png", "reference/furnished_streets.png"),
    "towns": _drawn(
        "above close eyes options", *(f"results/towns/{name}.jpg" for name in ("above", "close", "eyes_*", "options"))
    ),
    "actors": Step(
        ("reference/actors.png", "reference/actors_varied.png"),
        (
            "python examples/04_meet_the_actors.py docs/reference/actors.png",
            "python examples/04_meet_the_actors.py docs/reference/actors_varied.png varied",
        ),
    ),
    "cameras": Step(
        ("reference/cameras.png",), ("python examples/05_look_through_cameras.py docs/reference/cameras.png",)
    ),
    "message": Step(("learn/message.svg",), ("python scripts/draw_message.py",)),
    "plots": Step(
        tuple(
            f"results/{name}.svg"
            for name in ("latency", "policy_speed", "speed", "detection_bytes", "sAMOTA_over_bytes")
        ),
        ("python scripts/draw_results.py",),
    ),
    "messages": Step(
        ("results/messages.svg",),
        (
            "python scripts/measure_messages.py docs/results/messages.csv --seeds ''"
            " --selections in_turn,learned,need,score,random,when2com --svg docs/results/messages.svg",
        ),
    ),
    "real_traffic": Step(
        ("results/real_traffic.svg",),
        ("python scripts/plot_real_traffic.py docs/results/real_traffic.csv docs/results/real_traffic",),
    ),
    "real_sweeps": Step(
        ("results/sweeps.png", "results/real_sweeps/*.png"),
        (
            "python scripts/compare_sweeps.py {data}/real --clips 8 --figure docs/results/sweeps.png",
            "python scripts/measure_real_sweeps.py {data}/real --page docs/results/real_sweeps.md"
            " --frames kitti_000000,kitti_000001,kitti_000002,av2_7fab_0",
        ),
    ),
    "pasted": Step(
        ("results/pasted.png",),
        (
            "coopsim paste {data}/real --out {tmp}/pasted --actors 12 --seed 3",
            "cp {tmp}/pasted/paste.png docs/results/pasted.png",
        ),
    ),
}
"""All steps by name."""

OTHERS: Mapping[str, str] = {
    "assets/favicon.svg": "by hand",
    "learn/frame.svg": "by hand",
    "reference/built.svg": "by hand",
    "reference/walls.svg": "by hand; tests/unit/test_house.py compares it with the walls",
    "learn/bev_image.png": "the planes that `BevImage` gives for a frame, side by side",
    "reference/exported_town.png": "pyxodr, of `coopsim map export opendrive town`",
}
"""Pictures that no step draws, and what drew them."""


PROGRAMS = {
    "python": [sys.executable],
    "coopsim": [sys.executable, "-c", "from coopsim.cli import main; raise SystemExit(main())"],
}
"""Programs of this Python."""


def run(command: str) -> None:
    """Run a command in the root of the repository, with this Python; `page PAGE` runs a page's example in its folder.

    Raises:
        subprocess.CalledProcessError: it fails.
    """
    words = shlex.split(command)
    if words[0] == "page":
        page = DOCS / words[1]
        (code,) = re.findall(r"```python\n(.*?)```", page.read_text(encoding="utf-8"), flags=re.DOTALL)
        subprocess.run([sys.executable, "-c", code], cwd=page.parent, check=True)
        return
    programs = {
        "python": [sys.executable],
        "coopsim": [sys.executable, "-c", "from coopsim.cli import main; raise SystemExit(main())"],
    }
    words = [word for each in words for word in programs.get(each, [each])]
    subprocess.run(words, cwd=ROOT, check=True)


def draw(names: Sequence[str], do: Callable[[str], object] = run) -> None:
    """Run the commands of steps in order."""
    for name in names:
        print(f"{name}: {', '.join(STEPS[name].pictures)}", flush=True)
        with tempfile.TemporaryDirectory() as folder:
            for command in STEPS[name].commands:
                do(command.replace("{tmp}", folder).replace("{data}", os.environ.get("COOPSIM_DATA", "")))


def listing() -> str:
    """Return all steps with what they draw and run, and the pictures that none draws."""
    steps = (
        "\n".join([f"{name}: {', '.join(step.pictures)}", *(f"    {each}" for each in step.commands)])
        for name, step in STEPS.items()
    )
    return "\n".join([*steps, "no step:", *(f"    {name}: {how}" for name, how in OTHERS.items())])


def main(arguments: Sequence[str] | None = None) -> None:
    """Read the arguments, draw or list."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("steps", nargs="*", metavar="STEP", help=f"of {', '.join(STEPS)}; default: all")
    parser.add_argument("--without", nargs="+", default=[], metavar="STEP", help="steps that are left out")
    parser.add_argument("--list", action="store_true", help="list the steps, draw nothing")
    given = parser.parse_args(arguments)
    if unknown := sorted({*given.steps, *given.without} - {*STEPS}):
        parser.error(f"unknown step {', '.join(unknown)}; accepted: {', '.join(STEPS)}")
    if given.list:
        print(listing())
        return
    data = "COOPSIM_DATA" in os.environ
    if blind := [name for name in given.steps if STEPS[name].needs_data and not data]:
        parser.error(f"{', '.join(blind)} reads recordings or maps: let COOPSIM_DATA name their folder")
    draw(
        [
            name
            for name in given.steps or [each for each, step in STEPS.items() if data or not step.needs_data]
            if name not in given.without
        ]
    )


if __name__ == "__main__":
    main()
