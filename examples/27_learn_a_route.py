"""Train a car to steer along routes in drawn towns, and compare it with planners in towns that are new to all.

The network first imitates the planner `idm_aeb`, which pure pursuit steers, then goes on by PPO.

`python 27_learn_a_route.py 150000 runs/driver` trains for 150,000 steps, keeps the network in a folder, and drives 200
held-out routes to compare; the same command goes on from where it was stopped. Without a number it shows the way in
seconds, and the driver has learned next to nothing.
"""

import sys
from itertools import accumulate
from pathlib import Path
from tempfile import TemporaryDirectory

import gymnasium
import numpy as np

from coopsim.bench.results.statistics import mean_interval, rate_difference, rate_interval
from coopsim.envs import DriveEnv, PlannedDriver
from coopsim.types.driving import LARGEST_STEERING_RAD

try:
    import torch
    from stable_baselines3 import PPO
    from stable_baselines3.common.monitor import Monitor
    from stable_baselines3.common.vec_env import DummyVecEnv, VecNormalize
except ImportError:
    print("this example needs Stable-Baselines3: pip install 'coopsim[rl]'")
    raise SystemExit(0) from None

TOWNS = range(32)  # of training; held-out ones have seeds from HELD_OUT on
HELD_OUT = 10_000
ROUTES = {"route_m": (100, 200), "dt_s": 0.2}  # a decision every 0.2 s
SHOWN, PIECE = 30_000, 24_576  # steps that the planner shows, and after which PPO's network is kept
GAMMA = 0.98  # rewards 10 s ahead count a third
SHARES = gymnasium.spaces.Box(-1.0, 1.0, (2,), np.float32)
SCALE = np.float32([[8.0, LARGEST_STEERING_RAD], [3.0, LARGEST_STEERING_RAD]])  # of shares below and above 0


def from_shares(shares):
    """Return the action of shares in [-1, 1]: 0 keeps the speed and goes straight on."""
    shares = np.clip(shares, -1.0, 1.0)
    return np.where(shares > 0, SCALE[1], SCALE[0]) * shares


def to_shares(action):
    """Return the shares of an action."""
    return action / np.where(action > 0, SCALE[1], SCALE[0])


def make():
    """Make the environment of the learner."""
    env = DriveEnv(place="town", place_seed=TOWNS, **ROUTES)
    return Monitor(gymnasium.wrappers.TransformAction(env, from_shares, SHARES))


def lessons(count):
    """Have the planner drive; return observations, its actions as shares, and the sums of rewards that followed.

    At times the car is pushed off its course, so that the lessons show how to come back.
    """
    env, rng, seen, shares, returns = (
        DriveEnv(place="town", place_seed=TOWNS, **ROUTES),
        np.random.default_rng(0),
        [],
        [],
        [],
    )
    for seed in range(count):
        if len(seen) >= count:
            break
        (now, _), over, rewards, push = env.reset(seed=seed), False, [], np.zeros(2)
        driver = PlannedDriver(env.parallel, "idm_aeb")
        while not over:
            action = driver.act()
            seen.append(now)
            shares.append(to_shares(action))
            push = rng.normal(0.0, [1.0, 0.1]) if rng.random() < 0.1 else 0.8 * push
            pushed = np.clip(action + push, env.action_space.low, env.action_space.high).astype(np.float32)
            now, reward, terminated, truncated, _ = env.step(pushed)
            rewards.append(reward)
            over = terminated or truncated
        returns += list(accumulate(rewards[::-1], lambda after, reward: reward + GAMMA * after))[::-1]
    return tuple(np.array(each, np.float32) for each in (seen, shares, returns))


def imitate(model, view, shown, rounds):
    """Fit the network's actions to those of the lessons, and its values to the rewards that followed."""
    view.obs_rms.update(shown[0])
    seen, shares, returns = (torch.as_tensor(each) for each in (view.normalize_obs(shown[0]), *shown[1:]))
    optimizer = torch.optim.Adam(model.policy.parameters(), 1e-3)
    weight = torch.tensor([1.0, 10.0])  # a wrong angle leaves the lane, a wrong acceleration is made up for
    for _ in range(rounds):
        for rows in torch.randperm(len(seen)).split(256):
            meant = model.policy.get_distribution(seen[rows]).distribution.mean
            values = model.policy.predict_values(seen[rows])[:, 0]
            loss = (weight * (meant - shares[rows]).square()).mean() + 0.01 * (values - returns[rows]).square().mean()
            optimizer.zero_grad()
            loss.backward()
            optimizer.step()
    print(f"imitation: loss {loss.item():.3f} after {rounds} rounds of {len(seen)} steps", flush=True)


def train(steps, shown, folder):
    """Imitate, then train; each piece goes on from the network that the last one has kept in the folder."""
    network, normalized = folder / "network.zip", folder / "view.pkl"
    cars = DummyVecEnv([make] * (8 if shown == SHOWN else 1))
    if not network.exists():
        view = VecNormalize(cars, norm_reward=False)
        # Small steps from many drives at once: larger ones forget what was imitated.
        settings = {"n_steps": 1024, "batch_size": 512, "n_epochs": 4, "learning_rate": 3e-5, "gae_lambda": 0.9}
        settings |= {"clip_range": 0.1, "target_kl": 0.01}
        layers = {"net_arch": [256, 256], "log_std_init": -2.5}
        model = PPO("MlpPolicy", view, policy_kwargs=layers, gamma=GAMMA, **settings, device="cpu", seed=0)
        imitate(model, view, lessons(shown), 30)
        keep(model, view, network, normalized)
    view = VecNormalize.load(normalized, cars)
    view.training = False  # the network has learned what it sees with these means
    model = PPO.load(network, env=view, device="cpu")
    while model.num_timesteps < steps:
        model.learn(min(PIECE, steps - model.num_timesteps), reset_num_timesteps=False)
        print(f"{model.num_timesteps} steps: {how_it_went(model)}", flush=True)
        keep(model, view, network, normalized)
    return model, view


def keep(model, view, network, normalized):
    """Write the network, and how it sees observations."""
    view.save(normalized)
    model.save(network)


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
        print(name)
        for key in ENDS:
            rate = rate_interval(np.array([100.0 * info[key] for info in infos]))
            print(f"  {key} {rate.mean:.1f} % [{rate.low:.1f}, {rate.high:.1f}]")
        way = mean_interval(np.array([100 * info["route_completion"] for info in infos]))
        print(f"  route_completion {way.mean:.1f} % [{way.low:.1f}, {way.high:.1f}]")
        took = [info["seconds"] for info in infos if info["arrive_dest"]]
        print(f"  {np.mean(took) if took else np.nan:.1f} s for routes that end at the goal")
    success = {name: np.array([100.0 * info["arrive_dest"] for info in infos]) for name, infos in last.items()}
    for name in success if routes > 1 else ():
        change = rate_difference(success[name], success["learned"])
        if name != "learned" and change is not None:
            difference, p_value = change
            text = f"{difference.mean:+.1f} [{difference.low:+.1f}, {difference.high:+.1f}]"
            print(f"learned - {name}: {text} arrive, p = {p_value:.2g}")


ENDS = ("arrive_dest", "crash", "crash_vehicle", "crash_human", "out_of_road", "out_of_route", "max_step")


def main(steps, folder, routes=200, shown=SHOWN):
    """Train for so many steps, and compare on so many held-out routes."""
    folder.mkdir(parents=True, exist_ok=True)
    compare(drivers(*train(steps, shown, folder)), routes)


if __name__ == "__main__":
    if len(sys.argv) > 2:
        main(int(sys.argv[1]), Path(sys.argv[2]), *map(int, sys.argv[3:]))
    else:
        with TemporaryDirectory() as kept:
            main(256, Path(kept), routes=2, shown=256)
