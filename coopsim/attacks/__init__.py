"""Attacks: the lies of agents, in their sensor data, detections, tracks, features, poses, stamps and messages.

Input is what an attacker senses and hears; output is what leaves it instead of the truth. Each file has one kind; the
interface, and what applies attacks to the messages of a frame, are in `coopsim.interfaces`.
"""

from coopsim.interfaces.attack import ATTACKS, Attack, AttackerView, make_attack
from coopsim.support.moved import moved

__all__ = ["ATTACKS", "Attack", "AttackerView", "make_attack"]

moved(f"{__name__}.attack", "coopsim.interfaces.attack")
