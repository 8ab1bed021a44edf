"""A clock of the parts of a frame: environment, messages, policy, and the parts that a policy names itself."""

from __future__ import annotations

import time
from collections import defaultdict
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from coopsim.agents.policy import Policy
    from coopsim.comms.uplinks.uplink import Uplink


class PartClock:
    """Wall time by part. What runs within a part is taken from the part around it.

    The making of messages, `uplink`, runs within the environment's step, and is counted by itself: a network's encoder
    is there. A policy with a mapping `timings`, of seconds by part since its making, has these parts as well.

    Attributes:
        running: whether time is counted now.

    Args:
        policy: its uplinks are clocked from now on.
    """

    def __init__(self, policy: Policy) -> None:
        self.running = False
        self._seconds: defaultdict[str, float] = defaultdict(float)
        self._inner_s = 0.0
        self._frames = 0
        self._policy, self._before = policy, dict[str, float]()
        make = policy.make_uplink if hasattr(policy, "make_uplink") else None
        if make is not None:
            with suppress(AttributeError):  # an object without room for attributes is not clocked by part
                policy.make_uplink = self._clocked(make)  # type: ignore[method-assign]

    @contextmanager
    def part(self, name: str) -> Iterator[None]:
        """Count the time of a block."""
        outer_s, self._inner_s = self._inner_s, 0.0
        started = time.perf_counter()
        try:
            yield
        finally:
            spent_s = time.perf_counter() - started
            if self.running:
                self._seconds[name] += spent_s - self._inner_s
            self._inner_s = outer_s + spent_s

    def tick(self) -> None:
        """End a frame."""
        own = dict(getattr(self._policy, "timings", None) or {})
        if self.running:
            self._frames += 1
            for name, seconds in own.items():
                self._seconds[name] += seconds - self._before.get(name, 0.0)
        self._before = own

    @property
    def ms(self) -> dict[str, float]:
        """Mean milliseconds a frame, by part."""
        return {name: 1000 * seconds / max(self._frames, 1) for name, seconds in self._seconds.items()}

    def _clocked(self, make: Callable[..., Uplink]) -> Callable[..., Uplink]:
        clocked: set[int] = set()

        def make_clocked(*arguments: Any) -> Uplink:
            uplink = make(*arguments)
            if id(uplink) not in clocked:
                clocked.add(id(uplink))
                for name in ("messages", "contents"):  # with a budget the environment asks for contents
                    self._wrap(uplink, name)
            return uplink

        return make_clocked

    def _wrap(self, uplink: Uplink, name: str) -> None:
        method = getattr(uplink, name, None)
        if method is None:
            return

        def timed(observations: Any) -> Any:
            with self.part("uplink"):
                return method(observations)

        with suppress(AttributeError):
            setattr(uplink, name, timed)
