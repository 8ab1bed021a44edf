"""Learners' libraries take the wrapped environments, and learn for a few updates. Each is skipped if not installed."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest

import coopsim
from coopsim.envs.wrappers import BevImage, Driving, FixedSize, FixedTracks, Flatten, WithoutInfos

# Libraries warn of each other's versions, of shapes that are not theirs, and of settings for a few steps.
pytestmark = pytest.mark.filterwarnings("ignore")

SMALL: dict[str, Any] = {"vehicles": 10, "lidar": None, "max_cycles": 12, "detector": "simulated"}

ROWS = {"detections": 8, "messages": 2, "received": 4}


def needs(module: str, install: str) -> Any:
    return pytest.importorskip(module, reason=f"needs {module}: pip install {install}", exc_type=ImportError)


def one_car() -> Any:
    return coopsim.single_env("crossing", tracker="late_fusion", others="late_fusion", control="policy", **SMALL)


def cars() -> Any:
    return Flatten(FixedSize(Driving(coopsim.parallel_env("crossing", control="policy", **SMALL)), **ROWS))


FOR_SB3: dict[str, tuple[str, Callable[[], Any]]] = {
    "rows": ("MlpPolicy", lambda: Flatten(FixedSize(one_car(), **ROWS))),
    "picture": ("CnnPolicy", lambda: BevImage(one_car(), size=40)),
    "both": ("MultiInputPolicy", lambda: BevImage(FixedSize(one_car(), **ROWS), size=40)),
    "tracks": (
        "MlpPolicy",
        lambda: Flatten(FixedSize(FixedTracks(coopsim.single_env("crossing", **SMALL), tracks=4), **ROWS)),
    ),
}


@pytest.fixture
def sb3() -> Any:
    torch = needs("torch", "'coopsim[rl]'")
    library = needs("stable_baselines3", "'coopsim[rl]'")
    torch.manual_seed(0)
    return library


def few_updates(sb3: Any, policy: str, env: Any) -> None:
    model = sb3.PPO(policy, env, n_steps=16, batch_size=16, n_epochs=1, device="cpu")
    before = [weights.detach().clone() for weights in model.policy.parameters()]
    steps = 3 * 16 * model.n_envs
    model.learn(steps)
    assert model.num_timesteps == steps
    after = list(model.policy.parameters())
    assert all(bool(weights.isfinite().all()) for weights in after)
    assert any(bool((old != new).any()) for old, new in zip(before, after, strict=True))
    env.close()


@pytest.mark.parametrize("form", FOR_SB3)
def test_stable_baselines3_learns(sb3: Any, form: str) -> None:
    policy, make = FOR_SB3[form]
    env = make()
    needs("stable_baselines3.common.env_checker", "'coopsim[rl]'").check_env(env)
    few_updates(sb3, policy, env)


def test_supersuit_makes_agents_the_environments_of_a_vector(sb3: Any) -> None:
    supersuit = needs("supersuit", "'coopsim[rl]'")
    env = supersuit.pettingzoo_env_to_vec_env_v1(cars())
    few_updates(sb3, "MlpPolicy", supersuit.concat_vec_envs_v1(env, 2, num_cpus=1, base_class="stable_baselines3"))


def test_supersuit_steps_copies(sb3: Any) -> None:
    """Copies are made by pickling: they are whole, and independent of each other."""
    supersuit = needs("supersuit", "'coopsim[rl]'")
    agents = len(cars().possible_agents)
    envs = supersuit.concat_vec_envs_v1(supersuit.pettingzoo_env_to_vec_env_v1(cars()), 2, num_cpus=0)
    observations, _ = envs.reset(seed=3)
    assert observations.shape[0] == 2 * agents
    for _ in range(SMALL["max_cycles"] + 2):
        observations, *_ = envs.step(np.full(2 * agents, 1))
        assert np.isfinite(observations).all()
    assert not np.array_equal(observations[:agents], observations[agents:])
    envs.close()


def test_torchrl_takes_all_agents_and_one() -> None:
    torchrl = needs("torchrl.envs", "'coopsim[rl]'")
    env = WithoutInfos(cars())
    group = {"cars": env.possible_agents}
    wrapped = torchrl.PettingZooWrapper(env, group_map=group, use_mask=True, categorical_actions=True)
    torchrl.check_env_specs(wrapped)
    assert wrapped.rollout(5)["cars", "observation"].shape[:2] == (5, len(env.possible_agents))
    for form in (lambda env: Flatten(FixedSize(env, **ROWS)), lambda env: BevImage(env, size=40)):
        torchrl.check_env_specs(torchrl.GymWrapper(form(one_car())))


def test_torchrl_takes_a_vector() -> None:
    torchrl = needs("torchrl.envs", "'coopsim[rl]'")
    options = SMALL | {"tracker": "late_fusion", "control": "policy"}
    with coopsim.vector(
        "crossing", 2, workers=0, agents="single", autoreset_mode="Disabled", wrap=[FixedSize, Flatten], **options
    ) as envs:
        played = torchrl.GymWrapper(envs).rollout(SMALL["max_cycles"] + 3, break_when_any_done=False)
    assert played["observation"].shape[:2] == (2, SMALL["max_cycles"] + 3)
    assert int(played["next", "done"].sum()) == 2


def test_torchrl_learns() -> None:
    torchrl = needs("torchrl.envs", "'coopsim[rl]'")
    torch, modules = needs("torch", "'coopsim[rl]'"), needs("tensordict.nn", "'coopsim[rl]'")
    env = torchrl.GymWrapper(Flatten(FixedSize(one_car(), **ROWS)), categorical_action_encoding=True)
    torch.manual_seed(0)
    network = torch.nn.Linear(env.observation_spec["observation"].shape[-1], 5)
    actor = modules.ProbabilisticTensorDictSequential(
        modules.TensorDictModule(network, in_keys=["observation"], out_keys=["logits"]),
        modules.ProbabilisticTensorDictModule(
            ["logits"], ["action"], distribution_class=torch.distributions.Categorical, return_log_prob=True
        ),
    )
    optimizer = torch.optim.Adam(network.parameters())
    before = network.weight.detach().clone()
    for _ in range(3):
        with torch.no_grad():
            played = env.rollout(8, actor)
        loss = -(actor.get_dist(played).log_prob(played["action"]) * played["next", "reward"].squeeze(-1)).mean()
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
    assert bool(network.weight.isfinite().all()) and bool((network.weight != before).any())


@pytest.fixture
def rllib() -> Iterator[Any]:
    ray = needs("ray", "'coopsim[ray]'")
    ppo = needs("ray.rllib.algorithms.ppo", "'ray[rllib]'")
    ray.init(num_cpus=1, num_gpus=0, include_dashboard=False, log_to_driver=False, ignore_reinit_error=True)
    yield ppo
    ray.shutdown()


def _all_cars_for_rllib(config: Any) -> Any:
    from ray.rllib.env.wrappers.pettingzoo_env import ParallelPettingZooEnv

    return ParallelPettingZooEnv(cars())


@pytest.mark.long
@pytest.mark.parametrize("agents", ["one", "all"])
def test_rllib_learns(rllib: Any, agents: str) -> None:
    from ray.tune.registry import register_env

    one = agents == "one"
    register_env(agents, (lambda config: Flatten(FixedSize(one_car(), **ROWS))) if one else _all_cars_for_rllib)
    config = rllib.PPOConfig().environment(agents).env_runners(num_env_runners=0).learners(num_learners=0)
    config = config.training(train_batch_size=48, minibatch_size=24, num_epochs=1)
    if not one:
        config = config.multi_agent(policies={"shared"}, policy_mapping_fn=lambda agent, *_, **__: "shared")
    algorithm = config.build_algo()
    result = algorithm.train()
    assert result["env_runners"]["num_env_steps_sampled"] >= 48
    assert np.isfinite(result["env_runners"]["episode_return_mean"])
    algorithm.stop()
