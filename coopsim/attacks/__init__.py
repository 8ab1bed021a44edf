"""Attacks: the lies of agents, in their sensor data, detections, tracks, features, poses, stamps and messages.

Input is what an attacker senses and hears; output is what leaves it instead of the truth. Start with `attack.py`, which
has the interface; `lying_agents.py` applies attacks to the messages of a frame, and each other file has one kind.
"""

from coopsim.attacks.attack import ATTACKS, Attack, AttackerView, make_attack

__all__ = ["ATTACKS", "Attack", "AttackerView", "make_attack"]
