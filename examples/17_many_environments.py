"""Step many environments at once, in processes: for a learner that drives one car, and with all agents."""

import numpy as np

import coopsim
from coopsim.envs.wrappers import FixedSize, Flatten

options = {"lidar": None, "max_cycles": 5, "detector": "simulated", "seed": 1}

# One car of each environment learns to drive, and what it observes is one array: a gymnasium VectorEnv.
one = {"agents": "single", "tracker": "late_fusion", "others": "late_fusion", "control": "policy", "reward": "mota"}
with coopsim.vector("crossing", 4, workers=2, wrap=[FixedSize, Flatten], **one, **options) as learners:
    print(learners.observation_space.shape, learners.action_space)
    observations, infos = learners.reset()
    rng = np.random.default_rng(0)
    total = np.zeros(learners.num_envs)
    for _ in range(12):  # after an episode's last step, the next step begins another one
        actions = rng.integers(learners.single_action_space.n, size=learners.num_envs)
        observations, rewards, terminations, truncations, infos = learners.step(actions)
        total += rewards
    print("rewards by environment:", total.round(2))

# All agents of each environment act: lists with one dict by agent for each environment.
policies = [coopsim.make_policy("late_fusion") for _ in range(3)]
with coopsim.vector("crossing", 3, workers=1, **options) as everybody:
    observations, infos = everybody.reset()
    for policy, specs in zip(policies, everybody.call("agent_specs"), strict=True):
        policy.reset(specs)
    over = False
    while not over:
        actions = [policy.act(seen) for policy, seen in zip(policies, observations, strict=True)]
        observations, rewards, terminations, truncations, infos = everybody.step(actions)
        over = all(truncations[0].values())
    for score in everybody.call("score"):  # before the next step begins new episodes
        print(f"HOTA {score['HOTA']:.1f} %")
