"""Axes of a benchmark: options whose values differ between conditions, with units and labels.

Any option of environments is an axis, inner ones by dots (`weather.rain_mm_h`), and so is any parameter of policies
(`policy.hits`). Those of `AXES` have units of their own, and short forms in a grid.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from coopsim.errors import InvalidValueError
from coopsim.interfaces.attack_option import spell_attacks
from coopsim.support.checks import require_non_negative, require_number, require_probability

if TYPE_CHECKING:
    from coopsim.bench.grid.cell import Condition

DEFAULT = "default"
"""The value of an option of which a condition says nothing."""

NOBODY_LIES = "nobody lies"
"""The condition in which all agents are honest, in words."""

POLICY = "policy."
"""Beginning of the names of axes that are parameters of policies."""

LATENCY, LOSS, RATE, ATTACKS = "latency_s", "loss", "channel.bandwidth.rate_bit_s", "attacks"
POSITION, HEADING = "position_noise_m", "heading_noise_rad"


def _free(**values: Any) -> None:
    """Accept anything: what an option accepts, its environment says."""


@dataclass(frozen=True, slots=True)
class Axis:
    """An option of a condition, with its labels.

    Attributes:
        option: name of the option; `policy.x` is the parameter x of policies.
        name: name for readers.
        unit: unit in which it is shown.
        scale: factor from the option's unit to the shown one.
        endless: text of an infinite value, and of None.
        less_harms: True where a smaller value disturbs more.
        named: the values are names, in no order but that of their texts.
        usual: value in a condition that does not say; None: the environment's own.
        column: name in results, if it is not the option's; its values are in the shown unit.
        short: attribute of `Grid` that is its short form, and a flag of the command; empty: none.
        from_short: turns a value of the short form into the option's.
        require: raises unless a value by name is accepted.
        along: axes that vary together with this one: each of their values belongs to one value of this.
    """

    option: str
    name: str
    unit: str = ""
    scale: float = 1.0
    endless: str = "none"
    less_harms: bool = False
    named: bool = False
    usual: Any = None
    column: str = ""
    short: str = ""
    from_short: Callable[[Any], Any] = float
    require: Callable[..., None] = _free
    along: tuple[Axis, ...] = ()

    @property
    def title(self) -> str:
        """The name, with the names of axes that vary along."""
        return " and ".join(axis.name for axis in (self, *self.along))

    @property
    def label(self) -> str:
        """The title with its unit, if it has one, for plots."""
        return self.heading + "".join(f", with {axis.name}" for axis in self.along)

    @property
    def heading(self) -> str:
        """The name with its unit, if it has one."""
        return self.name + (f" ({self.unit})" if self.unit else "")

    def value(self, condition: Condition) -> float | str:
        """Return the condition's value in the shown unit; the text of a name, empty for none."""
        return self.shown(condition.get(self.option))

    def shown(self, value: Any) -> float | str:
        """Return an option's value in the shown unit; the text of a name, empty for none."""
        if self.named:
            return "" if value is None else str(value)
        # 12 digits, because 0.07 * 100 is not 7.
        return math.inf if value is None else float(f"{value * self.scale:.12g}")

    def text(self, condition: Condition) -> str:
        """Format the condition's value with its unit, and those of axes that vary along."""
        return " and ".join(axis.own_text(axis.value(condition)) for axis in (self, *self.along))

    def own_text(self, value: float | str) -> str:
        """Format a shown value with its unit."""
        if isinstance(value, str):
            return value or self.endless
        return f"{value:g} {self.unit}".rstrip() if math.isfinite(value) else self.endless

    def phrase(self, condition: Condition) -> str:
        """Return the title with the value, as "latency 300 ms"."""
        honest = self.option == ATTACKS and not self.along and not self.value(condition)
        return NOBODY_LIES if honest else f"{self.title} {self.text(condition)}"

    def harm(self, value: float | str) -> tuple[float, str]:
        """Return what rises with the harm of a shown value: names by their texts, after that of none."""
        if isinstance(value, str):
            return float(value != ""), value
        return (-value if self.less_harms or value == math.inf else value), ""

    def clean(self, value: Any) -> Any:
        """Return a value as conditions have it. Raises `InvalidValueError` if it is not accepted."""
        if value is None or self.option not in _KNOWN:
            return value
        if self.option == ATTACKS:
            return _spelled(value)
        self.require(**{self.option: value})
        return float(value)


def _spelled(attacks: object) -> str:
    """Return attacks as one text; empty for "none"."""
    if not isinstance(attacks, str):
        raise InvalidValueError(f'attacks must be texts like "cav_1=ghost + rsu_0=remove" or "none", got {attacks!r}')
    return "" if attacks == "none" else spell_attacks(attacks)


def _require_rate(**values: Any) -> None:
    # Less than a bit per second is a mistake, and its airtime may not fit the clock.
    require_number(">= 1e-6 (inf: no limit)", lambda rate: rate >= 1e-6, **values)


def _from_ms(latency: float) -> float:
    return float(latency / 1000)  # a product with 0.001 has other bits


def _from_mbit(rate: float) -> float:
    return float(rate * 1e6)


_PLUS, _SHARE = require_non_negative, require_probability
_OWN, _DEG = "the environment's own", 180.0 / math.pi

# fmt: off
AXES = (
    Axis(LATENCY, "latency", "ms", 1e3, usual=0.0, short="latencies_ms", from_short=_from_ms, require=_PLUS),
    Axis(LOSS, "loss", "%", 1e2, usual=0.0, short="losses", require=_SHARE),
    Axis(POSITION, "position noise", "m", usual=0.0, short="position_noises_m", require=_PLUS),
    Axis(HEADING, "heading noise", "°", _DEG, usual=0.0, column="heading_noise_deg", short="heading_noises_deg",
         from_short=math.radians, require=_PLUS),
    Axis(RATE, "bandwidth", "Mbit/s", 1e-6, "no limit", less_harms=True, usual=math.inf, column="bandwidth_bit_s",
         short="bandwidths_mbit_s", from_short=_from_mbit, require=_require_rate),
    Axis("penetration", "penetration", "%", 1e2, _OWN, less_harms=True, short="penetrations", require=_SHARE),
    Axis(ATTACKS, "attacks", endless=NOBODY_LIES, named=True, usual="", short="attacks", from_short=str),
)
# fmt: on
"""The axes with short forms. Those of the channel and the pose are in every condition."""

_KNOWN = {axis.option: axis for axis in AXES}

USUAL = {axis.option: axis.usual for axis in AXES}
"""The value of each in a condition that says nothing of it; None: the environment's own."""

_UNITS = {
    "_mbit_s": "Mbit/s", "_bit_s": "bit/s", "_bytes": "bytes", "_mm_h": "mm/h", "_m_s": "m/s", "_m_s2": "m/s²",
    "_per_s": "per s", "_hz": "Hz", "_deg": "°", "_rad": "rad", "_ms": "ms", "_dbm": "dBm", "_db": "dB", "_m": "m",
    "_s": "s",
}  # fmt: skip

_LESS_HARMS = ("budget_bytes", "communication_range_m", "fog_visibility_m", "range_m", "max_range_m")
"""Options of which less is worse, by the last part of their names."""


def axis_of(option: str, values: Iterable[Any] = ()) -> Axis:
    """Return the axis of an option. That of one without a short form is named unless all its `values` are numbers."""
    if option in _KNOWN:
        return _KNOWN[option]
    named = any(each is not None and (isinstance(each, bool) or not isinstance(each, (int, float))) for each in values)
    end = next((end for end in _UNITS if option.endswith(end)), "")
    words = option.removesuffix(end).removeprefix(POLICY).replace("_", " ").replace(".", " ")
    less_harms = option.rpartition(".")[2] in _LESS_HARMS
    return Axis(option, words, _UNITS.get(end, ""), less_harms=less_harms, named=named)
