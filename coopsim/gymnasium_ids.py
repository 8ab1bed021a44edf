"""The ids under which gymnasium makes the single-agent environments, `coopsim/<name>-v<version>`.

`import coopsim` registers them, as gymnasium 1 has no plug-ins that it would find by itself. No environment is loaded:
gymnasium imports it when one is made.
"""

from __future__ import annotations

from gymnasium.envs.registration import register, registry

from coopsim.catalog import ENVIRONMENTS_HOME, NAMESPACE

VERSIONED_NAMES = (
    "crossing-v2",
    "file-v2",
    "highway-v2",
    "merge-v2",
    "occluded_crossing-v2",
    "parking_street-v2",
    "platoon-v2",
    "replay-v2",
    "roundabout-v2",
    "t_junction-v2",
    "town-v2",
    "urban_grid-v2",
)
"""The environments that come with coopsim, as `ENVIRONMENTS` has them: they are listed here as well, because looking
them up would load the simulator."""


def register_with_gymnasium(versioned: str) -> None:
    """Let `gymnasium.make` know an environment, unless it does already."""
    name = f"{NAMESPACE}/{versioned}"
    if name not in registry:
        register(name, f"{ENVIRONMENTS_HOME}.single.single_agent_env:SingleAgentEnv", kwargs={"environment": name})


def register_environments() -> None:
    """Let `gymnasium.make` know the environments that come with coopsim."""
    for versioned in VERSIONED_NAMES:
        register_with_gymnasium(versioned)
