"""Attacks: the lies of agents, in their sensor data, detections, tracks, features, poses, stamps and messages.

Input is what an attacker senses and hears; output is what leaves it instead of the truth. Each file has one kind; the
interface, and what applies attacks to the messages of a frame, are in `coopsim.interfaces`. Attacks that aim at a
planner are classes with `plan(victim)`, see `aimed`.
"""

from coopsim.attacks.aimed import AimedAttack
from coopsim.attacks.victim_plan import VictimPlan
from coopsim.interfaces.attack import ATTACKS, Attack, AttackerView, make_attack
from coopsim.support.moved import moved

__all__ = ["ATTACKS", "AimedAttack", "Attack", "AttackerView", "VictimPlan", "make_attack"]

moved(f"{__name__}.attack", "coopsim.interfaces.attack")
