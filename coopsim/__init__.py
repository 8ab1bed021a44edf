"""coopsim: the gym for cooperative perception.

```python
import coopsim

policy = coopsim.make_policy("late_fusion")
env = coopsim.parallel_env("crossing", uplink=policy, latency_s=0.2, position_noise_m=0.2, max_cycles=50)
observations, infos = env.reset(seed=7)
policy.reset(env.agent_specs, seed=env.policy_seed)
while env.agents:
    observations, rewards, terminations, truncations, infos = env.step(policy.act(observations, infos))
print(env.score().table())
```

Names are loaded when first used: importing coopsim is quick, and loads neither torch nor OpenGL. It registers the
environments with gymnasium, whose `gymnasium.make("coopsim/crossing-v3", ego="cav_0", others="late_fusion")` makes one
for a single agent that learns.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING

from coopsim.support.interrupts import tell_in_one_line
from coopsim.support.lazy_names import lazy_names

if Path("".join(sys.argv[:1])).stem == "coopsim":  # the command: Ctrl-C may come while it imports
    sys.excepthook = tell_in_one_line

from coopsim.catalog import register_environments
from coopsim.version import __version__ as __version__

if TYPE_CHECKING:
    from coopsim.agents.policy import Needs as Needs
    from coopsim.agents.policy import Policy as Policy
    from coopsim.bench.benchmark import benchmark as benchmark
    from coopsim.bench.evaluate import Evaluation as Evaluation
    from coopsim.bench.evaluate import evaluate as evaluate
    from coopsim.bench.evaluate import evaluate_recordings as evaluate_recordings
    from coopsim.bench.evaluate import rollout as rollout
    from coopsim.catalog import ENVIRONMENTS as ENVIRONMENTS
    from coopsim.catalog import POLICIES as POLICIES
    from coopsim.catalog import make_policy as make_policy
    from coopsim.catalog import parallel_env as parallel_env
    from coopsim.data.export.export_run import check_export as check_export
    from coopsim.data.export.export_run import export as export
    from coopsim.envs import register_place as register_place
    from coopsim.envs.simulated.record_episode import record as record
    from coopsim.envs.single_agent_env import single_env as single_env
    from coopsim.envs.vector.make import vector as vector
    from coopsim.episode import RECORDERS as RECORDERS
    from coopsim.episode import Episode as Episode
    from coopsim.episode import Recorder as Recorder
    from coopsim.episode import run_episode as run_episode
    from coopsim.errors import CoopsimError as CoopsimError
    from coopsim.interfaces.attack import Attack as Attack
    from coopsim.interfaces.attack import AttackerView as AttackerView
    from coopsim.interfaces.defense import Defense as Defense
    from coopsim.interfaces.defense import Reception as Reception
    from coopsim.interfaces.defense import Trust as Trust
    from coopsim.interfaces.planner import PlannedCar as PlannedCar
    from coopsim.interfaces.planner import Planner as Planner
    from coopsim.support.precision import set_precision as set_precision
    from coopsim.world.places.description import PlaceDescription as PlaceDescription

register_environments()

_HOMES = {
    "Attack": "coopsim.interfaces.attack",
    "AttackerView": "coopsim.interfaces.attack",
    "Defense": "coopsim.interfaces.defense",
    "Reception": "coopsim.interfaces.defense",
    "Trust": "coopsim.interfaces.defense",
    "Needs": "coopsim.agents.policy",
    "Policy": "coopsim.agents.policy",
    "benchmark": "coopsim.bench.benchmark",
    "Evaluation": "coopsim.bench.evaluate",
    "check_export": "coopsim.data.export.export_run",
    "evaluate": "coopsim.bench.evaluate",
    "evaluate_recordings": "coopsim.bench.evaluate",
    "ENVIRONMENTS": "coopsim.catalog",
    "POLICIES": "coopsim.catalog",
    "export": "coopsim.data.export.export_run",
    "make_policy": "coopsim.catalog",
    "parallel_env": "coopsim.catalog",
    "single_env": "coopsim.envs.single_agent_env",
    "CoopsimError": "coopsim.errors",
    "PlannedCar": "coopsim.interfaces.planner",
    "Planner": "coopsim.interfaces.planner",
    "Episode": "coopsim.episode",
    "RECORDERS": "coopsim.episode",
    "Recorder": "coopsim.episode",
    "run_episode": "coopsim.episode",
    "record": "coopsim.envs.simulated.record_episode",
    "register_place": "coopsim.envs",
    "PlaceDescription": "coopsim.world.places.description",
    "rollout": "coopsim.bench.evaluate",
    "set_precision": "coopsim.support.precision",
    "vector": "coopsim.envs.vector.make",
}

__all__ = ["__version__", *_HOMES]


__getattr__, __dir__ = lazy_names(__name__, _HOMES)
