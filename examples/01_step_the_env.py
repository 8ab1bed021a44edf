"""Step the environment in a loop with a policy that comes with coopsim, and read the score."""

import coopsim

env = coopsim.parallel_env("crossing", latency_s=0.2, position_noise_m=0.2, max_cycles=50)
policy = coopsim.make_policy("late_fusion")
observations, infos = env.reset(seed=7)
policy.reset(env.agent_specs, seed=env.policy_seed)
while env.agents:
    observations, rewards, terminations, truncations, infos = env.step(policy.act(observations, infos))
print(env.score().table())
