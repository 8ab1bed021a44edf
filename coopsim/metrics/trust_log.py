"""The log of a receiver's trust in its senders, beside who lies."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field

from coopsim.episode import Episode, Recorder
from coopsim.types.lies import lying_senders

LEAST_TRUST = 0.5
"""Trust below which a sender counts as found: policies then believe it no more, see `coopsim.defenses`."""


@dataclass
class TrustLog:
    """Trust of one receiver in one episode; a sender counts as lying from its first lie on.

    Attributes:
        trust: trust of each frame and sender that was heard.
        lies: flag of a sender that lies, for each of these.
        found_after: frames from a sender's first lie to the first trust below `LEAST_TRUST`, by sender; infinite for
            one that is not found.
        frames: number of frames.
        passes: questions of the defence that cost a pass of the policy, over the episode.
    """

    trust: list[float] = field(default_factory=list)
    lies: list[bool] = field(default_factory=list)
    found_after: dict[str, float] = field(default_factory=dict)
    frames: int = 0
    passes: int = 0
    _first: dict[str, int] = field(default_factory=dict)

    def append(self, trust: Mapping[str, float], attackers: Collection[str], passes: int) -> None:
        """Add a frame: trust by sender, the senders that lie now, and the passes since the last frame."""
        for name in attackers:
            self._first.setdefault(name, self.frames)
        for name, value in trust.items():
            self.trust.append(value)
            self.lies.append(name in self._first)
            if name in self._first:
                self.found_after.setdefault(name, math.inf)
                if value < LEAST_TRUST:
                    self.found_after[name] = min(self.found_after[name], self.frames - self._first[name])
        self.frames += 1
        self.passes += passes


class TrustRecorder(Recorder):
    """Trust of each agent in its senders, as the policy that acts judges them; nothing without a defence."""

    def begin(self, episode: Episode) -> None:
        self._logs: dict[str, TrustLog] = {}

    def on_report(self, episode: Episode) -> None:
        judge = getattr(episode.policy, "judgements", None)  # a policy with its own `act` may have none
        for agent, (trust, passes) in ({} if judge is None else judge(episode.env.agents)).items():
            self._logs.setdefault(agent, TrustLog()).append(trust, lying_senders(episode.lies), passes)

    def records(self) -> dict[str, TrustLog]:
        return dict(self._logs)
