"""Let one agent learn, through gymnasium: it drives, a tracker reports its tracks, the others follow a policy.

The learner is a bandit: it draws a maneuver for each episode, and more and more often the one that gained most.
"""

import gymnasium
import numpy as np

from coopsim.envs import IDLE, MANEUVERS  # importing coopsim registers its environments with gymnasium


class Drive(gymnasium.Wrapper):
    """The reward is the metres driven, in the place of the environment's own, which is for tracks."""

    def step(self, action):
        """Drive on."""
        observation, _, terminated, truncated, info = self.env.step(action)
        return observation, observation["odometry"][0], terminated, truncated, info


roles = {"ego": "cav_0", "tracker": "late_fusion", "others": "late_fusion", "reward": "mota"}
env = Drive(gymnasium.make("coopsim/crossing-v3", **roles, control="policy", lidar=None, max_cycles=25))


def episode(maneuver, seed):
    """Drive one episode; return the metres."""
    env.reset(seed=seed)
    metres, over = 0.0, False
    while not over:
        _, reward, terminated, truncated, _ = env.step(maneuver)
        metres, over = metres + reward, terminated or truncated
    return metres


rng, gains = np.random.default_rng(0), [[] for _ in MANEUVERS]
for k in range(10):
    means = [np.mean(each) if each else np.inf for each in gains]  # each is tried at least once
    maneuver = rng.integers(len(MANEUVERS)) if k > 4 and rng.random() < 0.3 else int(np.argmax(means))
    gains[maneuver].append(episode(maneuver, seed=k))
    print(f"episode {k}: {MANEUVERS[maneuver]:>10}, {gains[maneuver][-1]:5.1f} m")
best = int(np.argmax([np.mean(each) for each in gains]))
for maneuver in (IDLE, best):
    print(f"{MANEUVERS[maneuver]} in an episode that is new to it: {episode(maneuver, seed=100):.1f} m")
print(f"its tracks by late fusion: MOTA {env.unwrapped.parallel.score().agents['cav_0']['MOTA']:.1f} %")
env.close()
