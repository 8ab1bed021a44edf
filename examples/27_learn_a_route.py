"""Train a car to steer along routes in drawn towns, and compare it with planners in towns that are new to all.

`python 27_learn_a_route.py 1200000 runs/driver` trains for about 40 minutes on one core, keeps the network in a folder,
and drives 200 held-out routes to compare; the same command goes on from where it was stopped. Without a number it
shows the way in seconds, and the driver has learned next to nothing.
"""

import sys
from pathlib import Path
from tempfile import TemporaryDirectory

import gymnasium
import numpy as np

from coopsim.bench.results.statistics import mean_interval, rate_difference, rate_interval
from coopsim.envs import DriveEnv, PlannedDriver, RouteReward
from coopsim.types.driving import LARGEST_STEERING_RAD

try:
    from stable_baselines3 import PPO
    from stable_baselines3.common.monitor import Monitor
    from stable_baselines3.common.vec_env import DummyVecEnv, VecNormalize
except ImportError:
    print("this example needs Stable-Baselines3: pip install 'coopsim[rl]'")
    raise SystemExit(0) from None

TOWNS = range(32)  # of training; held-out ones have seeds from HELD_OUT on
HELD_OUT = 10_000
ROUTES = {"route_m": (100, 200), "dt_s": 0.2}  # a decision every 0.2 s
ALONE = {"vehicles": 1, "parked": 0, "pedestrians": 0, "children": 0, "bicycles": 0, "scooters": 0}
GENTLE = RouteReward(crash=1.0, leave=1.0)  # at first: who fears to leave the road stands still
FIRST = 0.25  # share of the training alone on the road
PIECE = 40_000  # steps after which the training is kept
SHARES = gymnasium.spaces.Box(-1.0, 1.0, (2,), np.float32)


def from_shares(shares):
    """Return the action of shares in [-1, 1]: 0 keeps the speed and goes straight on."""
    share, turn = np.clip(shares, -1.0, 1.0)
    return np.float32([3.0 * share if share > 0 else 8.0 * share, LARGEST_STEERING_RAD * turn])


def make(alone):
    """Make the environment of the learner, in traffic or alone."""
    options = ALONE | {"reward": GENTLE} if alone else {}
    env = DriveEnv(place="town", place_seed=TOWNS, **ROUTES, **options)
    return Monitor(gymnasium.wrappers.TransformAction(env, from_shares, SHARES))


def begin(cars):
    """Return a network that knows nothing, and its view of observations."""
    view = VecNormalize(cars, gamma=0.99)
    settings = {"n_steps": 256, "batch_size": 256, "n_epochs": 10, "learning_rate": 3e-4, "gamma": 0.99}
    network = {"net_arch": [256, 256], "log_std_init": -1.5}
    return PPO("MlpPolicy", view, policy_kwargs=network, **settings, device="cpu", seed=0), view


def train(steps, folder):
    """Train; each piece goes on from the network that the last one has kept in the folder."""
    network, normalized = folder / "network.zip", folder / "view.pkl"
    done = PPO.load(network, device="cpu").num_timesteps if network.exists() else 0
    while done < steps:
        alone = done < FIRST * steps
        cars = DummyVecEnv([lambda alone=alone: make(alone)] * min(8, max(1, steps // 512)))
        cars.seed(done)
        if done:
            view = VecNormalize.load(normalized, cars)
            model = PPO.load(network, env=view, device="cpu")
        else:
            model, view = begin(cars)
        model.learn(min(PIECE, steps - done), reset_num_timesteps=False)
        view.save(normalized)
        model.save(network)
        print(f"{model.num_timesteps} steps: {how_it_went(model)}", flush=True)
        done = model.num_timesteps
        cars.close()
    return PPO.load(network, device="cpu"), VecNormalize.load(normalized, DummyVecEnv([lambda: make(True)]))


def how_it_went(model):
    """Return what the last drives of a training were like."""
    last = model.ep_info_buffer
    arrived = np.mean(model.ep_success_buffer) if model.ep_success_buffer else 0.0
    return f"{100 * arrived:.0f} % of {len(last)} drives arrived, reward {np.mean([each['r'] for each in last]):.1f}"


def drivers(model, view):
    """Return functions that return the action of each driver, from the environment and its observation, by name."""

    def learned(env):
        return lambda seen: from_shares(model.predict(view.normalize_obs(seen), deterministic=True)[0])

    def planned(name):
        return lambda env: (lambda driver: lambda seen: driver.act())(PlannedDriver(env.parallel, name))

    return {"learned": learned, **{name: planned(name) for name in ("idm_aeb", "route_follower")}}


def compare(found, routes):
    """Drive as many held-out routes, each in a town of its own, with all drivers; print what became of them."""
    env, last = DriveEnv(place="town", **ROUTES), {name: [] for name in found}
    for seed in range(HELD_OUT, HELD_OUT + routes):
        for name, driver in found.items():
            (seen, info), over = env.reset(seed=seed), False
            act, steps = driver(env), 0
            while not over:
                seen, _, terminated, truncated, info = env.step(act(seen))
                over, steps = terminated or truncated, steps + 1
            last[name].append(info | {"seconds": steps * ROUTES["dt_s"]})
    for name, infos in last.items():
        rates = {key: rate_interval(np.array([100.0 * info[key] for info in infos])) for key in ENDS}
        text = ", ".join(f"{key} {rate.mean:.1f} [{rate.low:.1f}, {rate.high:.1f}]" for key, rate in rates.items())
        way = mean_interval(np.array([100 * info["route_completion"] for info in infos]))
        hits = {kind: sum(info[f"crash_{kind}"] for info in infos) for kind in ("vehicle", "human", "object")}
        speed = np.mean([info["seconds"] for info in infos if info["arrive_dest"]] or [np.nan])
        print(
            f"{name}: {text}, route {way.mean:.1f} [{way.low:.1f}, {way.high:.1f}] %; {hits}, {speed:.0f} s to arrive"
        )
    success = {name: np.array([100.0 * info["arrive_dest"] for info in infos]) for name, infos in last.items()}
    for name in success if routes > 1 else ():
        change = rate_difference(success[name], success["learned"])
        if name != "learned" and change is not None:
            difference, p_value = change
            text = f"{difference.mean:+.1f} [{difference.low:+.1f}, {difference.high:+.1f}]"
            print(f"learned - {name}: {text} arrive, p = {p_value:.2g}")


ENDS = ("arrive_dest", "crash", "out_of_road", "out_of_route", "max_step")


def main(steps, routes, folder):
    """Train for so many steps, and compare on so many held-out routes."""
    folder.mkdir(parents=True, exist_ok=True)
    compare(drivers(*train(steps, folder)), routes)


if __name__ == "__main__":
    if len(sys.argv) > 2:
        main(int(sys.argv[1]), int(sys.argv[3]) if len(sys.argv) > 3 else 200, Path(sys.argv[2]))
    else:
        with TemporaryDirectory() as kept:
            main(512, 2, Path(kept))
