"""Channels from mappings and YAML files, for experiments that are written down."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import fields
from pathlib import Path
from typing import Any

from coopsim.comms.channel.bandwidth import Bandwidth
from coopsim.comms.channel.channel_config import ChannelConfig
from coopsim.comms.channel.clock import AgentClock
from coopsim.comms.channel.latency import EmpiricalLatency, GammaLatency, GaussianLatency, LogNormalLatency
from coopsim.comms.channel.link_config import LinkConfig
from coopsim.comms.channel.loss import BernoulliLoss, GilbertElliottLoss
from coopsim.comms.radio.radio_config import Radio
from coopsim.config.mappings import Given, make, read_mapping, require_mapping
from coopsim.errors import InvalidValueError, UnknownNameError
from coopsim.support.checks import require_choice

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
    of a clock's fields or of agents to such, `links` one of links to their fields.

    Raises:
        InvalidValueError: no such file, or a value that is not accepted.
        UnknownNameError: a field or a model that there is not.
    """
    if isinstance(given, ChannelConfig):
        return given
    parts: Mapping[str, Callable[[Any], Any]] = {
        "latency": _latency,
        "loss": lambda loss: _model("channel loss", _LOSSES, loss),
        "bandwidth": lambda bandwidth: make("channel bandwidth", Bandwidth, bandwidth),
        "radio": lambda radio: make("channel radio", Radio, radio),
        "clocks": _clocks,
        "links": _links,
    }
    mapping = read_mapping("channel", "a ChannelConfig", given)
    config: ChannelConfig = make(
        "channel", ChannelConfig, {key: parts[key](part) if key in parts else part for key, part in mapping.items()}
    )
    return config


def _model(what: str, models: Mapping[str, type[Any]], given: Any) -> Any:
    if given is None or isinstance(given, tuple(models.values())):
        return given
    name = require_mapping(what, given).get("model")
    if name is None:
        raise InvalidValueError(f"{what}: model must be given, got {sorted(given)}; accepted: {', '.join(models)}")
    require_choice(f"{what} model", name, models)
    return make(what, models[str(name)], {key: value for key, value in given.items() if key != "model"})


def _latency(given: Any, what: str = "channel latency") -> Any:
    if not (isinstance(given, Mapping) and given.get("model") == "empirical"):
        return _model(what, _LATENCIES, given)
    sources = ("path", "samples_s")
    for name in set(given) - {"model", *sources}:
        raise UnknownNameError(f"{what} option", name, sources)
    if len(given) != 2:
        raise InvalidValueError(f"{what}: an empirical latency has either path or samples_s, got {sorted(given)}")
    return EmpiricalLatency.from_csv(given["path"]) if "path" in given else _model(what, _LATENCIES, given)


def _clocks(given: Any) -> Any:
    if isinstance(given, AgentClock):
        return given
    by_agent = require_mapping("channel clocks", given)
    if any(field.name in by_agent for field in fields(AgentClock)):
        return make("channel clocks", AgentClock, given)
    return {name: make(f"channel clock of {name}", AgentClock, clock) for name, clock in by_agent.items()}


def _links(given: Any) -> Any:
    return {name: _link(f"channel link {name}", link) for name, link in require_mapping("channel links", given).items()}


def _link(what: str, given: Any) -> Any:
    if given is None or isinstance(given, LinkConfig):
        return given
    parts = dict(require_mapping(what, given))
    if "latency" in parts:
        parts["latency"] = _latency(parts["latency"], f"{what} latency")
    if "loss" in parts:
        parts["loss"] = _model(f"{what} loss", _LOSSES, parts["loss"])
    return make(what, LinkConfig, parts)
