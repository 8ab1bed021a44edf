"""Conformance checks: a user's plug-in goes in; nothing comes out, or `AssertionError` with the violation.

Start at the check of your kind of part; `harness.py` has what several share.
"""

from coopsim.interfaces.conformance import CONFORMANCE
from coopsim.testing.attack_checks import check_attack
from coopsim.testing.defense_checks import check_defense
from coopsim.testing.fusion_checks import check_fusion
from coopsim.testing.message_checks import check_codec, check_uplink
from coopsim.testing.metric_checks import check_metric
from coopsim.testing.perception_checks import check_detector, check_embedder
from coopsim.testing.planner_checks import check_planner
from coopsim.testing.policy_checks import check_policy

__all__ = [
    "check_attack",
    "check_codec",
    "check_defense",
    "check_detector",
    "check_embedder",
    "check_fusion",
    "check_metric",
    "check_planner",
    "check_policy",
    "check_uplink",
]

for _name in __all__:
    CONFORMANCE.register(_name.removeprefix("check_"))(globals()[_name])
