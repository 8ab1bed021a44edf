"""The device of a benchmark's networks: a parameter of the policies and detectors that have some."""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable
from typing import Any

from coopsim.bench.policy_spec import PolicySpec
from coopsim.config.spec import parse_spec, spell_spec
from coopsim.detection.detector import DETECTORS
from coopsim.errors import InvalidValueError
from coopsim.support.precision import arithmetic

PROCESSOR = "cpu"


def require_device(device: object) -> None:
    """Require the name of a device; whether it is here is seen where networks are put on it.

    Raises:
        InvalidValueError: it is no such name.
    """
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


def arithmetic_on(device: str) -> str:
    """Return the arithmetic of networks on a device by name; only for a GPU does this load torch."""
    if device == PROCESSOR:
        return arithmetic()
    from coopsim.nn.inference.devices import find_device, numbers_on

    return str(numbers_on(find_device(device))).removeprefix("torch.")


def _with_device(device: str, name: str, parameters: Any, make: Callable[..., Any]) -> str:
    return spell_spec(name, ({"device": device} if has_network(make) else {}) | dict(parameters))
