"""Draw docs/scenarios/<name>.png: every scenario and the village from above, with a drone, after a few seconds."""

from pathlib import Path

from PIL import Image

import coopsim
from coopsim.viz.bev import BevRenderer
from coopsim.world.scenario import SCENARIOS

FOLDER = Path(__file__).parents[1] / "docs" / "scenarios"
FRAMES = 40


def draw(name: str) -> None:
    """One picture, in few colours to be small."""
    env = coopsim.parallel_env(name if name in SCENARIOS else f"{name}.yaml", drones=1, max_cycles=FRAMES + 1)
    policy = coopsim.make_policy("late_fusion")
    observations, _ = env.reset(seed=3)
    policy.reset(env.agent_specs, seed=3)
    for _ in range(FRAMES):
        observations, *_ = env.step(policy.act(observations))
    picture = BevRenderer(env.road_map, 720, 540).draw(env.bev_frame())
    Image.fromarray(picture).quantize(32).save(FOLDER / f"{name}.png", optimize=True)


if __name__ == "__main__":
    for scenario in (*SCENARIOS, "village"):
        draw(scenario)
