"""Jobs of a detection measurement: one policy in one episode, run in any process."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

from coopsim.bench.detect.perceived.episode import Boxes, Receivers, perceive_episode
from coopsim.bench.detect.perceived.pace import Pace
from coopsim.bench.detect.perceived.perceived import Perceived
from coopsim.bench.engine.job import circumstances, traceback_of
from coopsim.bench.grid.cell import Cell, Condition
from coopsim.bench.policy_spec import PolicySpec
from coopsim.bench.store.fingerprint import changed_parts, fingerprint, key_of


@dataclass(frozen=True, eq=False)
class DetectJob:
    """An episode and everything that is needed to run it, as plain data.

    Attributes:
        policy: the policy.
        environment: name of the environment, or path of a scenario file.
        seed: of the episode.
        options: all options of the environment.
        pace: the frames that are measured.
        receivers: the agents that are: "cars" or "all".
        boxes: what of them: "detections" or "tracks".
    """

    policy: PolicySpec
    environment: str
    seed: int
    options: Mapping[str, Any]
    pace: Pace
    receivers: Receivers = "cars"
    boxes: Boxes = "detections"

    @cached_property
    def decided_by(self) -> str:
        """Everything that decides the outcome, as text, as it is when this is first asked for."""
        return self._fingerprint()

    def _fingerprint(self) -> str:
        cell = Cell(self.policy.text, Condition(self.environment), self.seed, self.pace.cycles)
        pace = {"warm_up": self.pace.warm_up, "every": self.pace.every, "frames": self.pace.frames}
        measured = {"detect": {**pace, "receivers": self.receivers, "boxes": self.boxes}}
        return fingerprint(cell, {**self.options, **measured}, self.policy)

    @property
    def key(self) -> str:
        """Name of the outcome in a store."""
        return key_of(self.decided_by)

    def run(self) -> DetectOutcome:
        """Run the episode. An exception becomes the outcome: a user's policy may raise anything."""
        started = time.perf_counter()
        perceived, traceback = None, None
        try:
            policy = self.policy.make()
            perceived = perceive_episode(
                policy,
                self.environment,
                seed=self.seed,
                options=self.options,
                pace=self.pace,
                receivers=self.receivers,
                boxes=self.boxes,
            )
        except Exception as error:
            traceback = traceback_of(error)
        seconds = time.perf_counter() - started
        if changed := changed_parts(self.decided_by, self._fingerprint()):
            return self.lost(f"{changed} changed since the command began, or differs here")
        return DetectOutcome(self, perceived, traceback, {"seconds": seconds, **circumstances()})

    def died(self, how: str) -> DetectOutcome:
        """Return the outcome where the process died."""
        return DetectOutcome(self, None, f"the process that ran this episode died: {how}\n")

    def lost(self, how: str) -> DetectOutcome:
        """Return the outcome where the machine or the cluster died."""
        return DetectOutcome(self, None, f"this episode was not run: {how}\n")


@dataclass(frozen=True, slots=True, eq=False)
class DetectOutcome:
    """The outcome of a job.

    Attributes:
        job: the job.
        perceived: what was perceived; None for a failed job.
        traceback: of the exception that made it fail.
        circumstances: data that differ between runs.
    """

    job: DetectJob
    perceived: Perceived | None
    traceback: str | None = None
    circumstances: Mapping[str, Any] = field(default_factory=dict)

    @property
    def reason(self) -> str | None:
        """The traceback's last line; None if the job did not fail."""
        return None if self.traceback is None else "".join(self.traceback.strip().splitlines()[-1:])
