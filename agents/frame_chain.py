"""What an agent knows from frame to frame: after the frame before this one, and after this one."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Generic, Protocol, TypeVar


class Memory(Protocol):
    """What is known after a frame."""

    @property
    def time_ns(self) -> int:
        """Time of the frame."""


M = TypeVar("M", bound=Memory)


@dataclass
class FrameChain(Generic[M]):
    """The memories of one agent.

    Attributes:
        before: after the frame before.
        now: after this frame, or, until it is made, after the newest one.
    """

    before: M | None = None
    now: M | None = None

    def begin(self, now_ns: int) -> M | None:
        """Begin a frame, or do it once more. Return what was known before it; a newer memory is forgotten."""
        if self.now is not None and self.now.time_ns != now_ns:
            self.before = self.now if self.now.time_ns < now_ns else None
        return self.before
