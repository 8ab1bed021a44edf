"""Channels from mappings and YAML files, for experiments that are written down."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import fields
from pathlib import Path
from typing import Any

from coopsim.checks import require_choice
from coopsim.comms.bandwidth import Bandwidth
from coopsim.comms.clock import AgentClock
from coopsim.comms.config import ChannelConfig
from coopsim.comms.latency import EmpiricalLatency, GammaLatency, GaussianLatency, LogNormalLatency
from coopsim.comms.loss import BernoulliLoss, GilbertElliottLoss
from coopsim.comms.radio import Radio
from coopsim.errors import InvalidValueError, UnknownNameError

Given = Mapping[str, Any]

_LATENCIES: Mapping[str, type[Any]] = {
    "gaussian": GaussianLatency,
    "log_normal": LogNormalLatency,
    "gamma": GammaLatency,
    "empirical": EmpiricalLatency,
}
_LOSSES: Mapping[str, type[Any]] = {"bernoulli": BernoulliLoss, "gilbert_elliott": GilbertElliottLoss}


def channel_config(given: ChannelConfig | Given | str | Path) -> ChannelConfig:
    """A channel from itself, from a mapping, or from the path of a YAML file with one.

    A mapping has the fields of `ChannelConfig`. `latency` and `loss` are mappings with a `model` ("gaussian",
    "log_normal", "gamma", "empirical"; "bernoulli", "gilbert_elliott") and its fields; an empirical latency may have
    the `path` of its file instead of `samples_s`. `bandwidth` and `radio` are mappings of their fields, `clocks` one
    of agents to the fields of theirs.

    Raises:
        InvalidValueError: no such file, or a value that is not accepted.
        UnknownNameError: a field or a model that there is not.
    """
    if isinstance(given, ChannelConfig):
        return given
    if isinstance(given, (str, Path)):
        given = _read(Path(given))
    if not isinstance(given, Mapping):
        raise InvalidValueError(f"channel must be a ChannelConfig, a mapping or the path of a YAML file, got {given!r}")
    parts: Mapping[str, Callable[[Any], Any]] = {
        "latency": _latency,
        "loss": lambda loss: _model("loss", _LOSSES, loss),
        "bandwidth": lambda bandwidth: _make("bandwidth", Bandwidth, bandwidth),
        "radio": lambda radio: _make("radio", Radio, radio),
        "clocks": _clocks,
    }
    config: ChannelConfig = _make(
        "channel", ChannelConfig, {key: parts[key](part) if key in parts else part for key, part in given.items()}
    )
    return config


def _read(path: Path) -> Any:
    import yaml

    try:
        return yaml.safe_load(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, yaml.YAMLError) as error:
        raise InvalidValueError(f"cannot read the channel in {path}: {error}") from error


def _make(what: str, made: type[Any], given: Any) -> Any:
    """An object from its fields; what is one, or None, is left as it is."""
    if given is None or isinstance(given, made):
        return given
    known = [field.name for field in fields(made) if field.init]
    for name in _mapping(what, given):
        if name not in known:
            raise UnknownNameError(f"{what} option", name, known)
    try:
        return made(**given)
    except TypeError as error:
        raise InvalidValueError(f"{what}: {error}") from error


def _model(what: str, models: Mapping[str, type[Any]], given: Any) -> Any:
    if given is None or isinstance(given, tuple(models.values())):
        return given
    name = _mapping(what, given).get("model")
    require_choice(f"{what} model", name, models)
    return _make(what, models[str(name)], {key: value for key, value in given.items() if key != "model"})


def _latency(given: Any) -> Any:
    if isinstance(given, Mapping) and given.get("model") == "empirical" and set(given) == {"model", "path"}:
        return EmpiricalLatency.from_csv(given["path"])
    return _model("latency", _LATENCIES, given)


def _clocks(given: Any) -> Any:
    if isinstance(given, AgentClock):
        return given
    return {name: _make(f"clock of {name}", AgentClock, clock) for name, clock in _mapping("clocks", given).items()}


def _mapping(what: str, given: Any) -> Given:
    if not isinstance(given, Mapping):
        raise InvalidValueError(f"{what} must be a mapping, got {given!r}")
    return given
