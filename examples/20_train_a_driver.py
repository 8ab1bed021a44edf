"""Train a car to drive by what it and others see, and compare it with the built-in planner on seeds new to both.

`python 20_train_a_driver.py 200000` trains for about half an hour on two free cores, then drives 400 episodes to
compare. Without a number it shows the way in seconds, and the driver has learned next to nothing.
"""

import sys

import gymnasium
import numpy as np

import coopsim
from coopsim.bench.results.statistics import rate_difference, rate_interval
from coopsim.envs.wrappers import DrivingRows, Flatten
from coopsim.envs.wrappers.driving_rows import DrivingRowsView

try:
    from stable_baselines3 import PPO
    from stable_baselines3.common.vec_env import SubprocVecEnv, VecNormalize
except ImportError:
    print("this example needs Stable-Baselines3: pip install 'coopsim[rl]'")
    raise SystemExit(0) from None

SITUATION, TRACKER = "occluded_pedestrian", "late_fusion"
OPTIONS = {"lidar": None, "dt_s": 0.2}  # no rays, whose returns are estimated, and a decision every 0.2 s: for speed
ROWS = {"tracks": 8, "points": 6, "ahead_m": 50.0}
ACCELERATIONS = np.float32([-8.0, -3.0, -1.0, 0.0, 1.0])  # m/s², from full braking to a calm start


def make():
    """Make the environment of the learner; the other cars share their detections, and follow the traffic model."""
    env = coopsim.single_env(SITUATION, tracker=TRACKER, control="acceleration", reward="safe_progress", **OPTIONS)
    choices = gymnasium.spaces.Discrete(len(ACCELERATIONS))
    env = gymnasium.wrappers.TransformAction(env, lambda choice: ACCELERATIONS[[choice]], choices)
    return Flatten(DrivingRows(env, **ROWS))


class Learned(coopsim.Planner):
    """The trained network as a planner: it is asked with the same numbers that it learned on."""

    view = DrivingRowsView(**ROWS)

    def __init__(self, model, normalize):
        self.model, self.normalize = model, normalize

    def plan(self, car: coopsim.PlannedCar) -> float:
        rows = self.view.rows(car, car.tracks)
        flat = np.concatenate([rows[name].reshape(-1) for name in sorted(rows)])
        choice, _ = self.model.predict(self.normalize(flat), deterministic=True)
        return float(ACCELERATIONS[choice])


def scores(planner, seeds):
    """Return whether the car crashed (0 or 100) and its progress (per cent of that at the speed limit), by seed."""
    runs = [coopsim.evaluate(TRACKER, SITUATION, seed=seed, planner=planner, **OPTIONS).score for seed in seeds]
    return np.array([run["crash"] for run in runs]), np.array([run["progress"] for run in runs])


def main(steps, seeds):
    """Train for so many steps, and compare on so many seeds."""
    cars = VecNormalize(SubprocVecEnv([make, make]))
    settings = {"n_steps": 256, "batch_size": 128, "learning_rate": 1e-3, "gamma": 0.98, "ent_coef": 0.01}
    model = PPO("MlpPolicy", cars, **settings, device="cpu", seed=0)
    model.learn(steps)
    cars.close()
    held_out = range(1000, 1000 + seeds)  # training draws its seeds below 2**32
    crash, progress = zip(
        *(scores(each, held_out) for each in ("idm_aeb", lambda: Learned(model, cars.normalize_obs))), strict=True
    )
    for name, crashed, way in zip(("idm_aeb", "learned"), crash, progress, strict=True):
        rate = rate_interval(crashed)
        print(f"{name}: {rate.mean:.0f} % crash [{rate.low:.0f}, {rate.high:.0f}], {way.mean():.0f} % progress")
    change, p_value = rate_difference(*crash)
    print(f"learned - idm_aeb: {change.mean:+.0f} points [{change.low:+.0f}, {change.high:+.0f}], p = {p_value:.2g}")


if __name__ == "__main__":
    main(*((int(sys.argv[1]), 200) if len(sys.argv) > 1 else (512, 2)))
