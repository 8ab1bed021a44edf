"""Overrides for single links: a roadside unit by cable, a bad modem, one direction that fails."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from coopsim.comms.channel.latency import Latency
from coopsim.comms.channel.loss import Loss
from coopsim.errors import InvalidValueError
from coopsim.support.checks import require_flag, require_instance

ANYONE = "*"


@dataclass(frozen=True, slots=True)
class LinkConfig:
    """Overrides of the channel on some links.

    Attributes:
        latency: replaces the channel's; None: the channel's.
        loss: replaces the channel's; None: the channel's.
        wired: a cable, without limits of range, radio or bandwidth.
    """

    latency: Latency | None = None
    loss: Loss | None = None
    wired: bool = False

    def __post_init__(self) -> None:
        require_instance(Latency, latency=self.latency)
        require_instance(Loss, loss=self.loss)
        require_flag(wired=self.wired)


_NO_OVERRIDE = LinkConfig()


def require_links(links: Mapping[str, LinkConfig]) -> None:
    """Raise `InvalidValueError` if a key is not of the form "sender > receiver", or a value no `LinkConfig`."""
    if not isinstance(links, Mapping):
        raise InvalidValueError(f'links must be LinkConfigs by "sender > receiver", got {links!r}')
    for name, link in links.items():
        if not isinstance(link, LinkConfig):
            raise InvalidValueError(f'links must be LinkConfigs by "sender > receiver"; got {link!r} for {name!r}')
    pairs = list(_pairs(links))
    for name, pair in zip(links, pairs, strict=True):
        if pairs.count(pair) > 1:
            raise InvalidValueError(f"links has {name!r} twice")


def link_of(links: Mapping[str, LinkConfig], sender: str, receiver: str) -> LinkConfig:
    """Return the override of a link: the one that names both agents, else the sender, the receiver, or neither."""
    by_pair = dict(zip(_pairs(links), links.values(), strict=True))
    for pair in ((sender, receiver), (sender, ANYONE), (ANYONE, receiver), (ANYONE, ANYONE)):
        if pair in by_pair:
            return by_pair[pair]
    return _NO_OVERRIDE


def agents_in(links: Mapping[str, LinkConfig]) -> set[str]:
    """Return the names of all agents in the keys of `links`."""
    return {agent for pair in _pairs(links) for agent in pair if agent != ANYONE}


def _pairs(links: Mapping[str, LinkConfig]) -> Iterator[tuple[str, str]]:
    for name in links:
        sender, arrow, receiver = str(name).partition(">")
        pair = sender.strip(), receiver.strip()
        if not (arrow and all(pair)) or ">" in receiver:
            raise InvalidValueError(
                f'a link in links is "sender > receiver", where "*" is any agent, as "rsu_0 > *"; got {name!r}'
            )
        yield pair
