"""Plan of a detection measurement: rows of a table, and the episodes that each row pools, as jobs of any process."""

from __future__ import annotations

import math
import reprlib
from collections.abc import Iterator, Mapping
from contextlib import closing
from dataclasses import asdict, dataclass, field
from functools import cached_property
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import coopsim
from coopsim.bench.detect.episode import Boxes, Pace, Receivers, Selection, pace_of, perceive_episode, receiving
from coopsim.bench.detect.perceived import Perceived
from coopsim.bench.detect.protocols import PROTOCOLS
from coopsim.bench.engine.job import traceback_of
from coopsim.bench.evaluate import listening_env
from coopsim.bench.grid.cell import Cell, Condition, last_line, scenario_options
from coopsim.bench.grid.policies import (
    PROCESSOR,
    arithmetic_on,
    detector_on,
    device_of_detector,
    device_of_policy,
    policy_on,
    require_device,
)
from coopsim.bench.store.fingerprint import changed_parts, fingerprint, key_of
from coopsim.catalog import PolicySpec, is_recordings_folder
from coopsim.errors import InvalidValueError
from coopsim.interfaces.attack_option import attacks_by_agent, spell_attacks
from coopsim.support.checks import (
    MOST_RUNS,
    as_runs,
    require_count,
    require_non_negative,
    require_positive,
)
from coopsim.support.rng import require_seed


@dataclass(frozen=True, slots=True, order=True)
class Disturbance:
    """Noise of all agents' poses, delay of all messages and lies in a row; None where the environment's own holds."""

    position_noise_m: float | None = None
    heading_noise_deg: float | None = None
    delay_ms: float | None = None
    attacks: str | None = None

    @property
    def options(self) -> dict[str, Any]:
        """Options of the environment that make it."""
        made: dict[str, Any] = {"attacks": self.attacks} if self.attacks else {}
        if self.position_noise_m is not None and self.heading_noise_deg is not None:
            made["position_noise_m"] = self.position_noise_m
            made["heading_noise_rad"] = math.radians(self.heading_noise_deg)
        if self.delay_ms is not None:
            made["latency_s"] = self.delay_ms / 1000
        return made

    @property
    def noise(self) -> str | None:
        """The noise as the command takes it, "0.4/0.4": m and degrees."""
        return None if self.position_noise_m is None else f"{self.position_noise_m:g}/{self.heading_noise_deg:g}"


@dataclass(frozen=True, eq=False)
class DetectJob:
    """An episode and everything that is needed to run it in any process, as plain data."""

    policy: PolicySpec
    environment: str
    seed: int
    options: Mapping[str, Any]
    pace: Pace
    selection: Selection = Selection()

    @cached_property
    def decided_by(self) -> str:
        """Everything that decides the outcome, as text, at the first access."""
        return self._fingerprint()

    def _fingerprint(self) -> str:
        condition = Condition(self.environment, attacks=self.options.get("attacks", ""))
        cell = Cell(self.policy.text, condition, self.seed, self.pace.cycles)
        measured = {**asdict(self.pace), **self.selection.as_dict()}
        return fingerprint(cell, {**self.options, "detect": measured}, self.policy)

    @property
    def key(self) -> str:
        """Name of the outcome in a store."""
        return key_of(self.decided_by)

    def run(self) -> DetectOutcome:
        """Run the episode. An exception becomes the outcome: a user's policy may raise anything."""
        try:
            outcome = DetectOutcome(self, self._perceive())
        except Exception as error:
            outcome = DetectOutcome(self, None, traceback_of(error))
        changed = changed_parts(self.decided_by, self._fingerprint())
        return self.lost(f"{changed} changed since the command began, or differs here") if changed else outcome

    def _perceive(self) -> Perceived:
        policy = self.policy.make()
        return perceive_episode(policy, self.environment, self.seed, self.options, self.pace, self.selection)

    def died(self, how: str) -> DetectOutcome:
        """Return the outcome where the process died."""
        return DetectOutcome(self, None, f"the process that ran this episode died: {how}\n")

    def lost(self, how: str) -> DetectOutcome:
        """Return the outcome where the machine or the cluster died."""
        return DetectOutcome(self, None, f"this episode was not run: {how}\n")


@dataclass(frozen=True, slots=True, eq=False)
class DetectOutcome:
    """The outcome of a job: its perceived episode, or the traceback of a failure."""

    job: DetectJob
    perceived: Perceived | None
    traceback: str | None = None

    @property
    def reason(self) -> str | None:
        """The traceback's last line; None if the job did not fail."""
        return last_line(self.traceback)


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
        object.__setattr__(self, "seeds", as_runs(seeds=self.seeds))
        for seed in self.seeds:
            require_seed(seed)
        if len(set(self.seeds)) < len(self.seeds):
            raise InvalidValueError(f"seeds must be distinct, got {reprlib.repr(self.seeds)}")
        require_device(self.device)
        object.__setattr__(self, "policies", tuple(policy_on(self.device, text) for text in self.policies))
        require_count(1, frames=self.frames)
        require_positive(every_s=self.every_s)
        object.__setattr__(self, "attacks", tuple(dict.fromkeys(map(spell_attacks, self.attacks))))
        Selection(self.receivers, self.boxes)
        PROTOCOLS.get(self.protocol)
        if self.within_m is not None:
            require_positive(within_m=self.within_m)
        for noise_m, noise_deg in self.noises:
            require_non_negative(position_noise_m=noise_m, heading_noise_deg=noise_deg)
        for delay_ms in self.delays_ms:
            require_non_negative(delay_ms=delay_ms)
        episodes = len(self.disturbances) * len(self.policies) * len(self.environments) * len(self.seeds)
        if episodes > MOST_RUNS:
            raise InvalidValueError(f"seeds times rows must be at most {MOST_RUNS:,} episodes, got {episodes:,}")

    @property
    def disturbances(self) -> list[Disturbance]:
        """Every noise with every delay and all lies."""
        noises: tuple[tuple[float | None, float | None], ...] = self.noises or ((None, None),)
        delays: tuple[float | None, ...] = self.delays_ms or (None,)
        lies: tuple[str | None, ...] = self.attacks or (None,)
        return [Disturbance(*noise, delay_ms, lie) for lie in lies for noise in noises for delay_ms in delays]

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
            options, _ = self._episode(text, environment, disturbance)
            with closing(listening_env(environment, self.specs[text].make(), options)) as env:
                receiving(env, self.selection)

    def jobs_of(self, policy: str, environment: str, disturbance: Disturbance) -> list[DetectJob]:
        """Return the episodes of a row, one for each seed."""
        options, pace = self._episode(policy, environment, disturbance)
        spec = self.specs[policy]
        return [DetectJob(spec, environment, seed, options, pace, self.selection) for seed in self.seeds]

    def rows(self) -> Iterator[tuple[str, str, Disturbance]]:
        """Yield policy, environment and disturbance of each row: the disturbances one after another."""
        for disturbance in self.disturbances:
            for policy in self.policies:
                for environment in self.environments:
                    yield policy, environment, disturbance

    def _episode(self, policy: str, environment: str, disturbance: Disturbance) -> tuple[dict[str, Any], Pace]:
        given = {**self.options, **disturbance.options}
        if self.box_detector is not None and not detects_itself(self.specs[policy]):
            given["detector"] = self.box_detector
        fixed_s = {**scenario_options(environment), **given}.get("dt_s")
        step_s, pace = pace_of(self.frames, self.every_s, (disturbance.delay_ms or 0.0) / 1000, fixed_s)
        one_thread = {} if is_recordings_folder(environment) else {"threads": 1}
        return {**one_thread, **given, "dt_s": step_s}, pace


def detects_itself(spec: PolicySpec) -> bool:
    """Return whether a policy perceives by itself, and so takes no notice of the environment's detector.

    That is a policy of tracking whose class has overridden `perceive`.
    """
    return sum("perceive" in vars(each) for each in spec.policy_class().__mro__) > 1


def usual_detector() -> str | None:
    """Return `LEARNED_DETECTOR` where its weights and torch are there; else None, the environment's default."""
    weights = Path(str(coopsim.__file__)).parent / "weights" / f"{LEARNED_DETECTOR}.safetensors"
    return LEARNED_DETECTOR if weights.is_file() and find_spec("torch") is not None else None
