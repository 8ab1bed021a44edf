"""Make labelled training clips of sweeps without labels: paste simulated actors into them."""

import os
import tempfile
from pathlib import Path

import numpy as np

try:
    from coopsim.learn.paste.object_finder import ObjectFinder
    from coopsim.learn.paste.paste import PasteSettings, paste
    from coopsim.learn.paste.picture import draw_pasted
except ImportError:
    print("this example needs torch: pip install 'coopsim[learn]'")
    raise SystemExit(0) from None

import coopsim


def find_sweeps(folder: Path) -> Path:
    """Take a real sweep from the folder COOPSIM_DATA, or else one of a drawn town, without its labels."""
    real = sorted(Path(os.environ.get("COOPSIM_DATA", "nowhere"), "real").glob("kitti_queue_*.npz"))
    if real:
        points = np.load(real[0])["points"]
    else:
        env = coopsim.parallel_env("crossing", lidar="HDL-32E", max_cycles=1)
        observations, _ = env.reset(seed=0)
        points = observations[env.agents[0]]["sweeps"]["lidar"][:, :4]
    folder.mkdir()
    np.savez(folder / "mine_0.npz", points=points)  # x, y, z in m, z = 0 on the ground, and intensity
    return folder


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as name:
        out = Path(name, "pasted")
        settings = PasteSettings(actors=(6, 6), reach_m=30.0)
        for frame in paste(find_sweeps(Path(name, "sweeps")), out, settings, ObjectFinder(least_score=0.15)):
            new = len(frame.points) - len(frame.before)
            print(f"{len(frame.boxes)} actors, {new:+d} points, {len(frame.doubtful)} doubtful places")
            draw_pasted(out / "paste.png", frame, settings.reach_m)
    # Then: coopsim train pillars town PASTED --out mine
