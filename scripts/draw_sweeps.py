"""Draw what one agent's LiDAR sees at a crossing, and what those of all agents see together.

    python scripts/draw_sweeps.py [--out docs/gallery/sweeps.png]

The points of the others are placed by the poses that the agents estimate.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

import coopsim
from coopsim.geometry.se3 import SE3
from coopsim.viz.point_picture import draw_points

PICTURE = Path(__file__).parents[1] / "docs" / "gallery" / "sweeps.png"
EGO, SEED, REACH_M, SIZE_PX, GAP_PX = "cav_0", 3, 45.0, (600, 500), 8


def main() -> None:
    """Read the arguments, run a frame, draw."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=PICTURE)
    given = parser.parse_args()
    env = coopsim.parallel_env(
        "crossing", lidar="HDL-64E", detector="none", detail="full", expose_ground_truth=True, dt_s=4.0, max_cycles=2
    )
    episode = coopsim.run_episode(env, coopsim.make_policy("no_fusion"), seed=SEED, most_steps=1)
    points, instances = [], []
    ego_SE3_world = _pose(episode.observations[EGO]).inverse()
    for agent, seen in sorted(episode.observations.items(), key=lambda each: each[0] != EGO):
        sweep = seen["sweeps"]["lidar"][:, :3].astype(np.float64)
        points.append(ego_SE3_world.apply(_pose(seen).apply(sweep)))
        instances.append(episode.infos[agent]["instances"]["lidar"])
    alone = draw_points(points[0], instances[0], REACH_M, SIZE_PX)
    together = draw_points(np.concatenate(points), np.concatenate(instances), REACH_M, SIZE_PX)
    gap = np.full((SIZE_PX[1], GAP_PX, 3), 255, dtype=np.uint8)
    Image.fromarray(np.hstack([alone, gap, together])).quantize(64).save(given.out, optimize=True)


def _pose(observation: Mapping[str, Any]) -> SE3:
    """Return the `world_SE3_base` that an agent estimates."""
    x, y, z, yaw = observation["pose"].tolist()
    return SE3.from_xyz_yaw([x, y, z], yaw)


if __name__ == "__main__":
    main()
