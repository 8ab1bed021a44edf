"""A link makes the streams whose draws matter, and no others."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

from coopsim.comms.channel import link as module
from coopsim.comms.channel.channel_config import ChannelConfig, LinkConfig
from coopsim.comms.channel.latency import GaussianLatency
from coopsim.comms.channel.link import Link
from coopsim.comms.channel.loss import BernoulliLoss, GilbertElliottLoss, Loss
from coopsim.comms.radio.radio_config import Radio
from coopsim.support.rng import stream

NAME = ("a", "b")


def purposes(config: ChannelConfig, monkeypatch: pytest.MonkeyPatch) -> tuple[set[str], Link]:
    """The purposes of a link's streams, and the link."""
    made: set[str] = set()

    def listed(seed: int, purpose: str, *owners: str) -> np.random.Generator:
        made.add(purpose)
        return stream(seed, purpose, *owners)

    monkeypatch.setattr(module, "stream", listed)
    return made, Link(config, 0, NAME)


@pytest.mark.parametrize(
    ("config", "wanted", "certain"),
    [
        (ChannelConfig(), set(), (0,)),
        (ChannelConfig(GaussianLatency(0.1)), set(), (100_000_000,)),
        (ChannelConfig(loss=BernoulliLoss(1.0)), set(), ()),
        (ChannelConfig(radio=Radio(), links={"a > b": LinkConfig(wired=True)}), set(), (0,)),
        (ChannelConfig(radio=Radio()), {"reception"}, None),
        (ChannelConfig(loss=BernoulliLoss(0.1)), {"loss"}, None),
        (ChannelConfig(loss=GilbertElliottLoss(0.0, 1.0)), {"loss"}, None),
        (ChannelConfig(GaussianLatency(0.0, 0.1)), {"latency"}, None),
        (ChannelConfig(duplication=0.1, bit_error_rate=0.1), {"duplication", "corruption"}, None),
    ],
)
def test_streams_are_made_where_their_draws_matter(
    config: ChannelConfig, wanted: set[str], certain: tuple[int, ...] | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    made, link = purposes(config, monkeypatch)
    assert (made, link.certain_delays_ns) == (wanted, certain)
    if certain is not None:
        fate = link.draw(b"wire", 1.0)
        assert (() if fate is None else fate.delays_ns) == certain


class Growing(GaussianLatency):
    """A user's model: the mean is not the delay."""

    __slots__ = ()

    def delay_s(self, normal: float) -> float:
        return 1.0 + abs(normal)


@dataclass(frozen=True)
class Never(BernoulliLoss):
    """A user's model: the probability is not that of a loss."""

    def draw(self, rng: np.random.Generator, burst: bool | None) -> tuple[bool, bool]:
        return True, False


def test_a_users_subclass_is_asked() -> None:
    slow, lossy = Growing(0.0), Never(0.0)
    assert isinstance(lossy, Loss)
    fate = Link(ChannelConfig(slow), 0, NAME).draw(b"", 1.0)
    assert fate is not None and fate.delays_ns[0] > 1e9
    assert Link(ChannelConfig(loss=lossy), 0, NAME).draw(b"", 1.0) is None
