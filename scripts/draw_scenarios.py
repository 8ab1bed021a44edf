"""Draw every scenario and the village from above, with a drone, to docs/reference/scenarios/<name>.png."""

import argparse
from pathlib import Path

from PIL import Image

import coopsim
from coopsim.viz.bev import BevRenderer
from coopsim.world.scenario import SCENARIOS

FOLDER = Path(__file__).parents[1] / "docs" / "reference" / "scenarios"
FRAMES = 40


def draw(name: str, folder: Path) -> None:
    """Draw one picture, with few colours to keep the file small."""
    env = coopsim.parallel_env(name if name in SCENARIOS else f"{name}.yaml", drones=1, max_cycles=FRAMES + 1)
    policy = coopsim.make_policy("late_fusion")
    observations, _ = env.reset(seed=3)
    policy.reset(env.agent_specs, seed=3)
    for _ in range(FRAMES):
        observations, *_ = env.step(policy.act(observations))
    picture = BevRenderer(env.road_map, 720, 540).draw(env.bev_frame())
    Image.fromarray(picture).quantize(32).save(folder / f"{name}.png", optimize=True)


def main() -> None:
    """Read the arguments, draw."""
    parser = argparse.ArgumentParser(description="Draw scenarios from above.")
    parser.add_argument("names", nargs="*", default=(*SCENARIOS, "village"), help="default: all")
    parser.add_argument("--out", type=Path, default=FOLDER, help="folder of the pictures (default: %(default)s)")
    args = parser.parse_args()
    for name in args.names:
        draw(name, args.out)


if __name__ == "__main__":
    main()
