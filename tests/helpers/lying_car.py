"""A crossing in which `cav_1` lies, for attacks on networks."""

from __future__ import annotations

from typing import Any

import coopsim
from coopsim.agents.policy import Policy
from coopsim.envs.parallel import CooperativeEnv
from coopsim.wire.observation_format import ObservationFormat


def begin(
    policy: str, attack: str | None, seed: int, **options: Any
) -> tuple[Policy, CooperativeEnv, ObservationFormat, Any]:
    """Return the policy, the environment, what unpacks its observations, and the first ones, packed."""
    made = coopsim.make_policy(policy)
    attacks = None if attack is None else {"cav_1": attack}
    env = coopsim.parallel_env("crossing", uplink=made, lidar="VLP-16", attacks=attacks, **options)
    form = ObservationFormat.to_unpack(env.agent_specs)
    packed, _ = env.reset(seed=seed)
    made.reset(env.agent_specs, seed=seed)
    return made, env, form, packed
