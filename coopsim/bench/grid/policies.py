"""Policies of a grid: the word "all", and the device and arithmetic of their networks and of a detector's."""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import cache
from typing import TYPE_CHECKING, Any

from coopsim.bench.grid.axis import POLICY
from coopsim.catalog import POLICIES, PolicySpec
from coopsim.config.spec import parse_spec, spell_spec
from coopsim.detection.detector import DETECTORS
from coopsim.errors import InvalidValueError, WeightsNotShippedError
from coopsim.support.precision import arithmetic

if TYPE_CHECKING:
    from coopsim.bench.grid.cell import Condition

ALL = "all"


def name_all(policies: Sequence[str]) -> tuple[tuple[str, ...], dict[str, str]]:
    """Replace "all" in a list of policies; the others stay as they are.

    It stands for every registered policy, those of installed packages among them, as it is by default. Left out are
    those that the list names itself, with whatever parameters, upper bounds, and those whose weights do not ship.
    Return the list, and the policies whose weights do not ship, with the reason.

    Raises:
        CoopsimError: the list has "all", and a policy that is not registered or needs a missing package.
    """
    if ALL not in policies:
        return tuple(policies), {}
    named = {PolicySpec.parse(policy).policy_class() for policy in policies if policy != ALL}
    known = {name: POLICIES.get(name) for name in POLICIES.names()}
    reasons = {name: _reason(name) for name, each in known.items() if each not in named and not each.needs.truth}
    rest = [name for name, reason in reasons.items() if not reason]
    place = policies.index(ALL)
    made = (*policies[:place], *rest, *policies[place + 1 :])
    return made, {name: reason for name, reason in reasons.items() if reason}


@cache
def _reason(name: str) -> str:
    """Return why a policy has no weights; empty where it has all it needs."""
    try:
        PolicySpec(name).make()
    except WeightsNotShippedError as error:
        return str(error)
    return ""


def of_cell(spec: PolicySpec, condition: Condition, *, trusted: bool = True) -> PolicySpec:
    """Return a cell's policy with the parameters that its condition sets, if it has them.

    The class of a policy that is not `trusted` is not imported here, and is taken to have them.

    Raises:
        InvalidValueError: one is among the policy's own parameters.
    """
    named = {option.removeprefix(POLICY): value for option, value in condition.settings if option.startswith(POLICY)}
    for name in named:
        if name in spec.parameters:
            raise InvalidValueError(f"{POLICY}{name} must be given once, got it as an axis and in {spec.text!r}")
    taken = {name: value for name, value in named.items() if not trusted or takes(spec, name)}
    return replace(spec, parameters={**spec.parameters, **taken}) if taken else spec


def takes(spec: PolicySpec, name: str) -> bool:
    """Return whether a policy has a parameter, or takes whatever it is given."""
    parameters = inspect.signature(spec.policy_class()).parameters
    return name in parameters or any(each.kind is each.VAR_KEYWORD for each in parameters.values())


PROCESSOR = "cpu"


def require_device(device: object) -> None:
    """Require the name of a device; its presence is checked where networks are put on it."""
    if not (isinstance(device, str) and re.fullmatch(r"cpu|auto|cuda(:\d+)?", device)):
        raise InvalidValueError(f"device must be cpu, cuda, cuda:1, ... or auto, got {device!r}")


def policy_on(device: str, text: str) -> str:
    """Return a policy's text with the device, if the policy takes one and states none; on the processor as it is."""
    spec = PolicySpec.parse(text)
    return text if device == PROCESSOR else _with_device(device, spec.target, spec.parameters, spec.policy_class())


def detector_on(device: str, given: Any) -> Any:
    """Return the text of a detector with the device, as `policy_on` does it; anything else as it is."""
    if device == PROCESSOR or not isinstance(given, str):
        return given
    name, parameters = parse_spec("detector", given)
    return _with_device(device, name, parameters, DETECTORS.get(name)) if name in DETECTORS.names() else given


def has_network(make: Callable[..., Any]) -> bool:
    """Return whether a policy or detector has networks, which take a device."""
    return "device" in inspect.signature(make).parameters


def device_of_policy(spec: PolicySpec) -> str | None:
    """Return the device of a policy's networks; None: it has none."""
    return _device(spec.policy_class(), spec.parameters)


def device_of_detector(detector: Any) -> str | None:
    """Return the device of the networks of a detector by its spec; None: it has none, or is no registered one."""
    name, parameters = parse_spec("detector", detector) if isinstance(detector, str) else ("", {})
    return _device(DETECTORS.get(name), parameters) if name in DETECTORS.names() else None


def arithmetic_of(policy: PolicySpec, detector: Any, *, trusted: bool = True) -> str:
    """Return the arithmetic of the networks of a policy and of a detector, on their devices.

    Without networks it is the processor's. The class of a policy that is not `trusted` is not imported here.
    """
    own = device_of_policy(policy) if trusted else str(policy.parameters.get("device", PROCESSOR))
    devices = {own, device_of_detector(detector)} - {None} or {PROCESSOR}
    return " and ".join(sorted({arithmetic_on(str(device)) for device in devices}))


def arithmetic_on(device: str) -> str:
    """Return the arithmetic of networks on a device by name; only for a GPU does this load torch."""
    if device == PROCESSOR:
        return arithmetic()
    from coopsim.nn.inference.backend import find_device, numbers_on

    return str(numbers_on(find_device(device))).removeprefix("torch.")


def _device(make: Callable[..., Any], parameters: Mapping[str, Any]) -> str | None:
    return str(parameters.get("device", PROCESSOR)) if has_network(make) else None


def _with_device(device: str, name: str, parameters: Any, make: Callable[..., Any]) -> str:
    return spell_spec(name, ({"device": device} if has_network(make) else {}) | dict(parameters))
