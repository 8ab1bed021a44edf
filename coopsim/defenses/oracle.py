"""The defence that is told who lies: the upper bound of every other."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from coopsim.errors import DefenseError
from coopsim.interfaces.defense import DEFENSES, Defense, Reception, Trust


@DEFENSES.register("oracle")
@dataclass(kw_only=True, eq=False)
class OracleDefense(Defense):
    """Trust in all senders but those that lie, which it is told: no competitor, so tables mark policies that have it.

    A sender that has lied is believed no more. It shows what finding every liar at once would be worth; what a liar
    says besides its lies is lost with them.
    """

    needs_truth: ClassVar[bool] = True

    def __post_init__(self) -> None:
        self._lied: frozenset[str] = frozenset()

    def judge(self, reception: Reception) -> Trust:
        if reception.attackers is None:
            raise DefenseError("oracle must be told who lies: let the policy act on infos that have the truth")
        self._lied |= reception.attackers & frozenset(reception.senders)  # a lie may be on its way for a while
        return Trust({name: float(name not in self._lied) for name in reception.senders})
