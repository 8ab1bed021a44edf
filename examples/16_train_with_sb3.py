"""Train a car to drive with Stable-Baselines3: PPO sees the nearest boxes, a tracker reports tracks for it."""

import gymnasium

import coopsim
from coopsim.envs.wrappers import FixedSize, Flatten

try:
    from stable_baselines3 import PPO
    from stable_baselines3.common.monitor import Monitor
except ImportError:
    print("this example needs Stable-Baselines3: pip install 'coopsim[rl]'")
    raise SystemExit(0) from None


class Drive(gymnasium.Wrapper):
    """The reward is the metres driven in a frame, in the place of the environment's own, which is for tracks."""

    def step(self, action):
        """Drive on."""
        observation, _, terminated, truncated, info = self.env.step(action)
        return observation, float(observation["odometry"][0]), terminated, truncated, info


def make():
    """Make the environment of one car that learns; the others follow late fusion."""
    roles = {"ego": "cav_0", "tracker": "late_fusion", "others": "late_fusion", "control": "policy"}
    env = coopsim.single_env("crossing", **roles, reward="mota", lidar=None, vehicles=10, max_cycles=16)
    return Monitor(Flatten(FixedSize(Drive(env), detections=8, messages=2, received=4)))


env = make()
model = PPO("MlpPolicy", env, n_steps=64, batch_size=32, n_epochs=4, device="cpu", seed=0)
model.learn(total_timesteps=256)  # a few seconds; to learn something, a hundred times as many
print("metres of each episode so far:", [round(metres) for metres in env.get_episode_rewards()])

observation, _ = env.reset(seed=100)
metres, over = 0.0, False
while not over:
    action, _ = model.predict(observation, deterministic=True)
    observation, reward, terminated, truncated, _ = env.step(action)
    metres, over = metres + reward, terminated or truncated
print(f"in an episode that is new to it: {metres:.0f} m")
print(f"its tracks by late fusion: MOTA {env.unwrapped.parallel.score().agents['cav_0']['MOTA']:.1f} %")
env.close()
