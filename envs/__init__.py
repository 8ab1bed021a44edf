"""Environments. Importing registers those that come with coopsim with PettingZoo, as `coopsim/<name>-v<version>`.

Names are loaded when first used. Read `parallel` (the environment), then `frames`, `exchange` and `options`; `makers`
makes environments by name.
"""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

import pettingzoo

from coopsim.catalog import NAMESPACE, VERSIONED_NAMES, parallel_env
from coopsim.support.lazy_names import lazy_names
from coopsim.types.messages import IDLE, MANEUVERS

if TYPE_CHECKING:
    from coopsim.envs.makers import file_env, register_place, replay_env, simulation_env, situation_env
    from coopsim.envs.message_gain import MessageGain
    from coopsim.envs.parallel import CooperativeEnv
    from coopsim.envs.rewards import DriveReward, DriveStep, MotaReward, Reward, SafeProgress

__all__ = [
    "IDLE",
    "MANEUVERS",
    "CooperativeEnv",
    "DriveReward",
    "DriveStep",
    "MessageGain",
    "MotaReward",
    "Reward",
    "SafeProgress",
    "file_env",
    "register_place",
    "replay_env",
    "simulation_env",
    "situation_env",
]

_HOMES = {
    "CooperativeEnv": "coopsim.envs.parallel",
    "MessageGain": "coopsim.envs.message_gain",
    **dict.fromkeys(("DriveReward", "DriveStep", "MotaReward", "Reward", "SafeProgress"), "coopsim.envs.rewards"),
    **dict.fromkeys(
        ("file_env", "register_place", "replay_env", "simulation_env", "situation_env"), "coopsim.envs.makers"
    ),
}

__getattr__, __dir__ = lazy_names(__name__, _HOMES)

for _versioned in VERSIONED_NAMES:
    pettingzoo.register("parallel", f"{NAMESPACE}/{_versioned}", partial(parallel_env, f"{NAMESPACE}/{_versioned}"))
