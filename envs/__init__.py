"""Environments. Importing registers those that come with coopsim with PettingZoo, as `coopsim/<name>-v<version>`.

Names are loaded when first used. Read `parallel` (the environment), then `frames`, `exchange` and `options`; `makers`
makes environments by name.
"""

from __future__ import annotations

from functools import partial
from importlib import import_module
from typing import TYPE_CHECKING, Any

import pettingzoo

from coopsim.catalog import DRIVE, NAMESPACE, VERSIONED_NAMES, parallel_env
from coopsim.support.lazy_names import lazy_names
from coopsim.types.messages import IDLE, MANEUVERS

if TYPE_CHECKING:
    from coopsim.envs.drive.parallel import DriveParallel
    from coopsim.envs.drive.planned import PlannedDriver
    from coopsim.envs.drive.reward import RouteReward
    from coopsim.envs.drive.single import DriveEnv
    from coopsim.envs.makers import file_env, register_place, replay_env, simulation_env, situation_env
    from coopsim.envs.message_gain import MessageGain
    from coopsim.envs.parallel import CooperativeEnv
    from coopsim.envs.rewards import DriveReward, DriveStep, MotaReward, Reward, SafeProgress

__all__ = [
    "IDLE",
    "MANEUVERS",
    "CooperativeEnv",
    "DriveEnv",
    "DriveParallel",
    "DriveReward",
    "DriveStep",
    "MessageGain",
    "MotaReward",
    "PlannedDriver",
    "Reward",
    "RouteReward",
    "SafeProgress",
    "file_env",
    "register_place",
    "replay_env",
    "simulation_env",
    "situation_env",
]

_HOMES = {
    "CooperativeEnv": "coopsim.envs.parallel",
    "DriveEnv": "coopsim.envs.drive.single",
    "DriveParallel": "coopsim.envs.drive.parallel",
    "PlannedDriver": "coopsim.envs.drive.planned",
    "RouteReward": "coopsim.envs.drive.reward",
    "MessageGain": "coopsim.envs.message_gain",
    **dict.fromkeys(("DriveReward", "DriveStep", "MotaReward", "Reward", "SafeProgress"), "coopsim.envs.rewards"),
    **dict.fromkeys(
        ("file_env", "register_place", "replay_env", "simulation_env", "situation_env"), "coopsim.envs.makers"
    ),
}

__getattr__, __dir__ = lazy_names(__name__, _HOMES)


def _drive(**options: Any) -> DriveParallel:
    made: DriveParallel = import_module("coopsim.envs.drive.parallel").DriveParallel(**options)
    return made


pettingzoo.register("parallel", DRIVE, _drive)
for _versioned in VERSIONED_NAMES:
    pettingzoo.register("parallel", f"{NAMESPACE}/{_versioned}", partial(parallel_env, f"{NAMESPACE}/{_versioned}"))
