"""Interfaces and registries of attacks, defences, planners and networks, at which these dock.

The core imports none of them: their registries find them, the built-in ones in `coopsim.attacks`, `coopsim.defenses`,
`coopsim.planning` and `coopsim.agents.learned_covariance`, others by entry points. `lying_agents` applies attacks to
the messages of a frame, and `guard` asks the defences for a policy.
"""
