"""Every registered uplink keeps what environments and receivers rely on; the check finds those that do not."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import coopsim
from coopsim.catalog import policies_on_boxes
from coopsim.comms.uplinks.share_detections import ShareDetections
from coopsim.comms.uplinks.share_features import ShareFeatures, ShareQueries
from coopsim.comms.uplinks.uplink import UPLINKS, Uplink
from coopsim.errors import UnknownNameError
from coopsim.geometry.boxes import Boxes3D
from coopsim.testing import check_uplink
from coopsim.types import AgentSpec, BevGrid, FeatureMap, InstanceQueries, Message, Observation, SensorView

GRID = BevGrid((-40, 40), (-20, 20), 2.0)


def occupancy(view: SensorView) -> FeatureMap:
    """One channel: the number of points in each cell, and how many that is."""
    points = np.concatenate([np.zeros((0, 3)), *(sweep.points for sweep in view.sweeps.values())])
    rows, columns = ((points[:, axis] - low) // GRID.cell_m for axis, low in ((1, -20.0), (0, -40.0)))
    inside = (rows >= 0) & (rows < GRID.shape[0]) & (columns >= 0) & (columns < GRID.shape[1])
    counts = np.zeros(GRID.shape)
    np.add.at(counts, (rows[inside].astype(int), columns[inside].astype(int)), 1)
    return FeatureMap(np.log1p(counts)[None], GRID, counts / max(counts.max(), 1))


def one_query(view: SensorView) -> InstanceQueries:
    box = Boxes3D.from_array([[5.0, 0, 0, 4, 2, 1.5, 0]])
    return InstanceQueries(np.full((1, 8), sum(map(len, view.sweeps.values()))), box, [0.5], [0])


MADE: dict[str, Any] = {
    "features": lambda spec, rng: ShareFeatures(occupancy),
    "queries": lambda spec, rng: ShareQueries(one_query),
}


@pytest.mark.parametrize("name", [*UPLINKS.names(), "points(keep=0.3)", "detections(codec=compact)"])
def test_uplink(name: str) -> None:
    check_uplink(MADE.get(name, name))


@pytest.mark.parametrize("policy", policies_on_boxes())
def test_uplinks_of_policies(policy: str) -> None:
    check_uplink(coopsim.make_policy(policy))


def test_an_unknown_name_is_told() -> None:
    with pytest.raises(UnknownNameError, match=r"unknown uplink 'detection'. Did you mean 'detections'"):
        check_uplink("detection")


class Altered(ShareDetections):
    """Sends messages with something changed."""

    def __init__(self, **changes: Any) -> None:
        super().__init__()
        self._changes = changes

    def message_with(self, sender: str, observation: Observation, payload: bytes) -> Any:
        return replace(super().message_with(sender, observation, payload), **self._changes)


class OtherContent(Altered):
    def __init__(self) -> None:
        super().__init__()
        self.content = "tracks"  # type: ignore[misc]


class NoMessage(ShareDetections):
    def message_with(self, sender: str, observation: Observation, payload: bytes) -> Any:
        return payload


class Counting(ShareDetections):
    """Remembers the last episode."""

    sent = 0

    def content_of(self, sender: str, observation: Observation) -> Any:
        type(self).sent += 1
        return super().content_of(sender, replace(observation, detections=observation.detections[: self.sent % 3]))


class Trusting(ShareDetections):
    """Reads what it receives, and believes it."""

    def hear(self, receiver: str, observation: Observation) -> None:
        for message in observation.inbox:
            self.codec.decode(message.payload)


class InOrder(ShareDetections):
    """Sends what depends on who is asked first."""

    def begin(self, spec: AgentSpec, rng: np.random.Generator) -> None:
        self.last = spec.name

    def content_of(self, sender: str, observation: Observation) -> Any:
        count = len(observation.detections) if sender != self.last else 0
        return super().content_of(sender, replace(observation, detections=observation.detections[:count]))


class Shared:
    """One object of a class for all agents of an episode."""

    def __init__(self, made: type[Uplink]) -> None:
        self._class, self._first, self._object = made, "", made()

    def __call__(self, spec: AgentSpec, rng: np.random.Generator) -> Any:
        if spec.name == self._first:
            self._object = self._class()
        self._first = self._first or spec.name
        return self._object


class Silent(Uplink):
    """Keeps quiet where there is nothing to say; sound."""

    content = "detections"

    def message(self, sender: str, observation: Observation) -> Message | None:
        return ShareDetections().message(sender, observation) if len(observation.detections) else None


def test_staying_silent_is_sound() -> None:
    check_uplink(lambda spec, rng: Silent())


@pytest.mark.parametrize(
    ("make", "match"),
    [
        (lambda: Altered(sender="somebody"), "Altered must name the sender"),
        (lambda: Altered(captured_ns=-1), "Altered must say when content was captured, 0 ns, got -1"),
        (lambda: Altered(codec="mine"), "codec 'mine' is not registered"),
        (OtherContent, "OtherContent states 'tracks', and sends 'detections'"),
        (lambda: Altered(payload=b"\x07nonsense"), "Altered must send what codec 'detections' decodes"),
        (NoMessage, "NoMessage must make messages, got b"),
        (Counting, "must send the same again in a later episode: the payload"),
        (Trusting, "Trusting must hear any inbox, got CodecError"),
        (lambda: None, "must be a coopsim Uplink, got None"),
    ],
)
def test_what_is_wrong_is_found(make: Callable[[], Any], match: str) -> None:
    with pytest.raises(AssertionError, match=match):
        check_uplink(lambda spec, rng: make())


def test_what_depends_on_the_order_of_agents_is_found() -> None:
    with pytest.raises(AssertionError, match="must not depend on the order of the agents"):
        check_uplink(Shared(InOrder))
