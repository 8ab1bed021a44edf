"""Plan of a detection measurement: rows of a table, and the episodes that each row pools, as jobs of any process."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import asdict, dataclass, field, replace
from functools import cached_property
from importlib.util import find_spec
from pathlib import Path
from typing import Any, ClassVar

import coopsim
from coopsim.bench.detect.episode import Boxes, Pace, Receivers, Selection, pace_of, perceive_episode, receiving
from coopsim.bench.detect.protocols import PROTOCOLS
from coopsim.bench.engine.job import Job
from coopsim.bench.grid.cell import Cell, CellResult, Condition, environment_options, scenario_options
from coopsim.bench.grid.grid import Grid
from coopsim.bench.grid.policies import (
    PROCESSOR,
    arithmetic_on,
    detector_on,
    device_of_detector,
    device_of_policy,
    policy_on,
)
from coopsim.bench.store.fingerprint import Sources
from coopsim.catalog import PolicySpec
from coopsim.episode import Recorder
from coopsim.interfaces.attack_option import attacks_by_agent
from coopsim.provided import listening_env
from coopsim.support.checks import as_runs, require_count, require_positive

EVERYWHERE = "all"
"""The environment of a row that pools all environments."""


def own_condition(environment: str, **named: Any) -> Condition:
    """Return a condition in which only what is `named` is set: the rest is the environment's own."""
    return Condition(**{**dict.fromkeys(Condition().columns()), **named, "scenario": environment})


@dataclass(frozen=True, slots=True, eq=False)
class DetectJob(Job):
    """An episode and everything that is needed to run it in any process, as plain data.

    Attributes:
        pace: the frames that are measured.
        selection: the receivers and boxes that are measured.
    """

    root: ClassVar[str] = "coopsim.bench.detect.episode"
    noun: ClassVar[str] = "episode"
    arrays: ClassVar[bool] = True

    pace: Pace = Pace(1)
    selection: Selection = Selection()

    @property
    def inputs(self) -> dict[str, Any]:
        return {**self.options, "detect": {**asdict(self.pace), **self.selection.as_dict()}}

    def measure(self, recorders: Sequence[Recorder] = ()) -> CellResult:
        """Run the episode: what was perceived is in the result's arrays."""
        options, environment = environment_options(self.cell, self.options), self.cell.condition.scenario
        seen = (self.policy.make(), environment, self.cell.seed, options, self.pace, self.selection, recorders)
        return CellResult(self.cell, arrays=perceive_episode(*seen).arrays())


LEARNED_DETECTOR = "pillars"


@dataclass(frozen=True)
class DetectPlan:
    """Plan of a detection measurement.

    Attributes:
        policies: policies, as `PolicySpec` reads them.
        environments: names, or paths of scenario files or of folders of recordings with sweeps.
        seeds: seeds, one episode each.
        frames: measured frames of an episode.
        noises: (m, degrees) of all agents' poses, a row each; empty: the environment's own.
        delays_ms: delays of messages, a row each; empty: the environment's own.
        attacks: lies of agents, a row each, as the environments' option `attacks`; empty text: all are honest. Agents
            that lie in any of them are no receivers, so that all rows have the same.
        every_s: least time between two measured frames.
        detector: detector of policies that detect nothing themselves; None: `LEARNED_DETECTOR` if it can be used, else
            the environment's default.
        receivers: "cars", or "all" agents.
        boxes: "detections", or the reported "tracks".
        protocol: protocol of the metrics.
        within_m: largest distance from the receiver of objects that count and of detections; None: the evaluation
            region.
        options: further options of all environments, plain data.
        device: device of networks, as `Grid.device`.

    Raises:
        CoopsimError: a value is not accepted.
    """

    policies: tuple[str, ...] = ("no_fusion", "late_fusion")
    environments: tuple[str, ...] = ("crossing",)
    seeds: tuple[int, ...] = (0, 1)
    frames: int = 20
    noises: tuple[tuple[float, float], ...] = ()
    delays_ms: tuple[float, ...] = ()
    attacks: tuple[str, ...] = ()
    every_s: float = 0.5
    detector: str | None = None
    receivers: Receivers = "cars"
    boxes: Boxes = "detections"
    protocol: str = "coopsim"
    within_m: float | None = None
    options: Mapping[str, Any] = field(default_factory=dict)
    device: str = PROCESSOR

    def __post_init__(self) -> None:
        position_m, heading_deg = zip(*self.noises, strict=True) if self.noises else ((0.0,), (0.0,))
        grid = Grid(
            self.policies,
            self.environments,
            self.delays_ms or (0.0,),
            position_noises_m=position_m,
            heading_noises_deg=heading_deg,
            pose="together",
            attacks=self.attacks or ("",),
            seeds=self.seeds,
            device=self.device,
        )
        object.__setattr__(self, "seeds", grid.seeds)
        # Rows are called as the user wrote them.
        object.__setattr__(
            self, "policies", tuple(policy_on(self.device, text) for text in as_runs(policies=self.policies))
        )
        object.__setattr__(self, "attacks", grid.attacks if self.attacks else ())
        require_count(1, frames=self.frames)
        require_positive(every_s=self.every_s)
        Selection(self.receivers, self.boxes)
        PROTOCOLS.get(self.protocol)
        if self.within_m is not None:
            require_positive(within_m=self.within_m)

    @property
    def disturbances(self) -> list[Condition]:
        """Every noise with every delay and all lies, in no environment yet."""
        noises: tuple[tuple[float | None, float | None], ...] = self.noises or ((None, None),)
        delays_s: list[float | None] = [each / 1000 for each in self.delays_ms] or [None]
        return [
            own_condition(EVERYWHERE, attacks=lie, position_noise_m=m, heading_noise_deg=deg, latency_s=delay_s)
            for lie in self.attacks or (None,)
            for m, deg in noises
            for delay_s in delays_s
        ]

    @cached_property
    def selection(self) -> Selection:
        """The measured receivers and boxes."""
        liars = dict.fromkeys(name for lie in self.attacks for name in attacks_by_agent(lie))
        return Selection(self.receivers, self.boxes, tuple(liars))

    @cached_property
    def specs(self) -> dict[str, PolicySpec]:
        """The policies by their text."""
        return {text: PolicySpec.parse(text) for text in self.policies}

    @cached_property
    def box_detector(self) -> str | None:
        """The detector of policies that detect nothing themselves; None: the environment's default."""
        detector: str | None = detector_on(self.device, usual_detector() if self.detector is None else self.detector)
        return detector

    @cached_property
    def bounds(self) -> frozenset[str]:
        """The policies that are told the truth: upper bounds."""
        return frozenset(text for text, spec in self.specs.items() if spec.make().needs.truth)

    def arithmetic(self, policy: str) -> str | None:
        """Return the arithmetic of a row's networks, see `coopsim.support.precision`; None: there are none."""
        spec = self.specs[policy]
        device = device_of_policy(spec) if detects_itself(spec) else device_of_detector(self.box_detector)
        return None if device is None else arithmetic_on(device)

    def check(self) -> None:
        """Make every policy in the first environment under all lies, and every environment for the first policy.

        Raises:
            CoopsimError: a name is unknown or a value is not accepted; the message says what is accepted.
        """
        policies, last = list(self.specs), self.disturbances[-1]
        lying = {each.attacks: each for each in reversed(self.disturbances)}.values()
        met = [(text, self.environments[0], each) for each in lying for text in policies]
        met += [(policies[0], environment, last) for environment in self.environments]
        for text, environment, disturbance in met:
            job = self._job(text, Condition(environment, disturbance.settings), self.seeds[0])
            options = environment_options(job.cell, job.options)
            with closing(listening_env(environment, job.policy.make(), options)) as env:
                receiving(env, self.selection)

    def jobs_of(self, policy: str, condition: Condition, sources: Sources | None = None) -> list[DetectJob]:
        """Return the episodes of a row, one for each seed; `sources` keeps digests for other rows."""
        sources = sources or Sources()
        jobs = [self._job(policy, condition, seed) for seed in self.seeds]
        return [replace(job, decided_by=job.fingerprint(sources)) for job in jobs]

    def jobs(self) -> list[DetectJob]:
        """Return the episodes of all rows."""
        sources = Sources()
        return [job for row in self.rows() for job in self.jobs_of(*row, sources)]

    def rows(self) -> Iterator[tuple[str, Condition]]:
        """Yield policy and condition of each row: the disturbances one after another."""
        for disturbance, policy, environment in itertools.product(self.disturbances, self.policies, self.environments):
            yield policy, Condition(environment, disturbance.settings)

    def _job(self, policy: str, condition: Condition, seed: int) -> DetectJob:
        """Return the job of an episode, without what decides it."""
        spec, given = self.specs[policy], dict(self.options)
        if self.box_detector is not None and not detects_itself(spec):
            given["detector"] = self.box_detector
        fixed_s = {**scenario_options(condition.scenario), **given}.get("dt_s")
        step_s, pace = pace_of(self.frames, self.every_s, condition.latency_s or 0.0, fixed_s)
        cell = Cell(policy, condition, seed, pace.cycles)
        return DetectJob(cell, {**given, "dt_s": step_s}, spec, "", pace=pace, selection=self.selection)


def detects_itself(spec: PolicySpec) -> bool:
    """Return whether a policy perceives by itself, and so takes no notice of the environment's detector.

    That is a policy of tracking whose class has overridden `perceive`.
    """
    return sum("perceive" in vars(each) for each in spec.policy_class().__mro__) > 1


def usual_detector() -> str | None:
    """Return `LEARNED_DETECTOR` where its weights and torch are there; else None, the environment's default."""
    weights = Path(str(coopsim.__file__)).parent / "weights" / f"{LEARNED_DETECTOR}.safetensors"
    return LEARNED_DETECTOR if weights.is_file() and find_spec("torch") is not None else None
