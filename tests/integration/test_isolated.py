"""Policies in processes of their own do the same, get nothing but observations, and fail alone."""

from __future__ import annotations

import os
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from representatives import all_of

import coopsim
from coopsim.bench.benchmark import benchmark
from coopsim.bench.grid.grid import Grid
from coopsim.bench.isolated.isolation import Isolation
from coopsim.bench.leaderboard import evaluate_each
from coopsim.bench.paper.provenance import Provenance
from coopsim.bench.store.store import Store
from coopsim.catalog import PolicySpec
from coopsim.cli import main
from coopsim.errors import InvalidValueError, IsolatedPolicyError

SALT = b"a secret of enough bytes"
OPTIONS: dict[str, Any] = {"vehicles": 8, "max_cycles": 6, "loss": 0.2, "latency_s": 0.1, "position_noise_m": 0.2}
APART = Isolation(60.0)
LONG = pytest.mark.long

NOSY = """
import os, sys, threading
import numpy as np
import coopsim
from coopsim.types import Tracks

class Nosy(coopsim.Policy):
    def reset(self, agent_specs, seed=0):
        super().reset(agent_specs, seed)
        self.counts["seed"] = seed in (7, int(SALTED))
        self.counts["imported envs"] = sum(name.startswith("coopsim.envs.parallel") for name in sys.modules)
        known = " ".join([*os.environ, *os.environ.values(), *sys.argv])
        self.counts["salt in sight"] = "secret" in known or "SECRET" in known
        self.counts["descriptors"] = len(os.listdir("/proc/self/fd")) if os.path.isdir("/proc/self/fd") else 0

    def track(self, agent, observation):
        return Tracks.empty()
"""

BOASTING = """
import coopsim
from coopsim.types import Tracks

class Boasting(coopsim.Defense):
    def judge(self, reception):
        return coopsim.Trust({})

class Policy(coopsim.Policy):
    needs = coopsim.Needs(uplink="detections")

    def __init__(self):
        self.defend(Boasting)

    def track(self, agent, observation):
        return Tracks.empty()

    def trust(self, agent):
        return {"cav_1": 7.0}
"""

BROKEN = """
import os, time
import coopsim
from coopsim.types import Tracks

class Raising(coopsim.Policy):
    def track(self, agent, observation):
        raise ValueError("no such luck")

class Dying(coopsim.Policy):
    def track(self, agent, observation):
        os._exit(3)

class Hanging(coopsim.Policy):
    def track(self, agent, observation):
        if observation.time_ns > 100_000_000:
            time.sleep(600)
        return Tracks.empty()

class Babbling(coopsim.Policy):
    def track(self, agent, observation):
        for descriptor in range(3, 32):
            try:
                os.write(descriptor, b"\\x05" + bytes(7) + b"nonse")
            except OSError:
                pass
        return Tracks.empty()
"""


class Boxes(coopsim.Recorder):
    """The boxes of all tracks, frame by frame."""

    def __init__(self) -> None:
        self.frames: list[np.ndarray] = []

    def on_step(self, episode: coopsim.Episode) -> None:
        tracks = episode.env.bev_frame(points=False).tracks.values()
        self.frames.append(np.concatenate([each.boxes.array for each in tracks]))


def tracks_of(policy: coopsim.Policy, **options: Any) -> tuple[list[np.ndarray], Any]:
    """Return the boxes of all tracks by frame, and the evaluation."""
    kept = Boxes()
    return kept.frames, coopsim.evaluate(policy, "crossing", seed=2, recorders=[kept], **(OPTIONS | options))


def require_the_same(spec: PolicySpec, **options: Any) -> None:
    here, score = tracks_of(spec.make(), **options)
    with APART.policy(spec) as policy:
        there, other = tracks_of(policy, **options)
    assert sum(map(len, here)) > 10
    for one, two in zip(here, there, strict=True):
        np.testing.assert_array_equal(one, two)
    assert score.messages == other.messages and score.counts == other.counts and score.method == other.method
    assert score.score.values == pytest.approx(other.score.values, rel=0, abs=0, nan_ok=True)


@pytest.mark.parametrize("name", all_of(["no_fusion", "late_fusion", "coop_fuse", "track_to_track"], "track_to_track"))
def test_the_same_tracks_messages_and_scores_as_in_one_process(name: str) -> None:
    require_the_same(PolicySpec.parse(name), lidar=None)


@pytest.mark.long
def test_the_same_of_a_policy_with_a_network() -> None:
    pytest.importorskip("torch")
    require_the_same(PolicySpec.parse("attfuse"), lidar="VLP-16", lidar_columns=256, vehicles=6, max_cycles=4)


def file_of(tmp_path: Path, text: str, name: str = "theirs.py") -> Path:
    path = tmp_path / name
    path.write_text(text)
    return path


def test_the_process_has_no_seed_no_salt_and_no_world(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("MY_SECRET", "secret")
    text = NOSY.replace("SALTED", str(Isolation(None, SALT).seed(7)))
    spec = PolicySpec.parse(f"{file_of(tmp_path, text, 'nosy.py')}:Nosy")
    with Isolation(60.0, SALT).policy(spec) as policy:
        counts = coopsim.evaluate(policy, "crossing", seed=7, lidar=None, **OPTIONS).counts
    assert counts["seed"] == 0
    assert counts["imported envs"] == 0 and counts["salt in sight"] == 0 and counts["descriptors"] < 6 * 4
    assert "coopsim_policy_nosy" not in sys.modules, "the class is not imported here"


@pytest.mark.parametrize(
    ("name", "message"),
    [
        pytest.param("Raising", r"raised an error in its own process(.|\n)*ValueError: no such luck", marks=LONG),
        ("Dying", r"is gone: its process ended \(exit status 3\)"),
        ("Hanging", "has not answered within 1 s"),
        ("Babbling", "answered nonsense"),
    ],
)
def test_a_broken_policy_fails_by_a_named_error(name: str, message: str, tmp_path: Path) -> None:
    spec = PolicySpec.parse(f"{file_of(tmp_path, BROKEN)}:{name}")
    started = time.monotonic()
    with pytest.raises(IsolatedPolicyError, match=message), Isolation(1.0).policy(spec) as policy:
        coopsim.evaluate(policy, "crossing", lidar=None, **OPTIONS)
    assert time.monotonic() - started < 100.0


def test_no_process_is_left_behind() -> None:
    with APART.policy(PolicySpec.parse("no_fusion")) as policy:
        pid = policy._spare.process._pid  # type: ignore[attr-defined]
        os.kill(pid, 0)
    with pytest.raises(ProcessLookupError):
        os.kill(pid, 0)
    with pytest.raises(IsolatedPolicyError, match="unknown parameter"):
        APART.policy(PolicySpec.parse("no_fusion(colour=3)")).__enter__()


@pytest.mark.usefixtures("jobs_here")
def test_a_benchmark_goes_on_without_the_broken_and_says_what_it_did(tmp_path: Path) -> None:
    grid = Grid((f"{file_of(tmp_path, BROKEN)}:Raising", "no_fusion"), frames=3, options={"lidar": None, "vehicles": 6})
    out, salted = tmp_path / "out", Isolation(60.0, SALT)
    broken, whole = benchmark(grid, out, isolation=salted)
    assert broken.failed and broken.reason == "ValueError: no such luck"
    assert not whole.failed
    for seed, same in ((salted.seed(0), True), (0, False)):
        rewards = coopsim.evaluate("no_fusion", "crossing", seed=seed, max_cycles=3, **grid.options).rewards
        assert np.array_equal(rewards, whole.rewards) == same, "the salt decides which episode is seed 0's"
    again = benchmark(grid, out, isolation=salted)
    assert [each.failed for each in again] == [True, False], "taken from the store"
    provenance = Provenance.from_data(Store(out).provenance())
    assert provenance.isolation == salted.as_data() and len(provenance.isolation["salt"]) == 64
    raw = b"".join(path.read_bytes() for path in out.rglob("*") if path.is_file())
    assert SALT not in raw and str(salted.seed(0)).encode() not in raw


def test_the_seed_of_a_drawn_place_does_not_tell_that_of_a_salted_episode() -> None:
    salted = Isolation(None, SALT)
    seed = salted.seed(3)
    assert salted.told_place(seed, seed) not in (None, seed, 3)
    assert salted.told_place(seed, 1004) == 1004 and salted.told_place(seed, None) is None
    assert Isolation().told_place(3, 3) == 3
    assert seed == Isolation(5.0, SALT).seed(3) != Isolation(None, SALT + b"!").seed(3)


def test_recordings_are_ranked_in_processes_of_their_own(recordings: Path) -> None:
    options: dict[str, Any] = {"sequences": None}
    here, there = (
        dict(evaluate_each(recordings, ("ego",), ("no_fusion",), isolation=each, **options))
        for each in (Isolation(), APART)
    )
    one, other = here["no_fusion"], there["no_fusion"]
    assert not isinstance(one, Exception) and not isinstance(other, Exception)
    assert one.count.values == other.count.values


def test_what_is_not_accepted_is_said_in_a_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    def handed(salt: bytes) -> int:
        (tmp_path / "salt").write_bytes(salt)
        return os.open(tmp_path / "salt", os.O_RDONLY)

    with pytest.raises(InvalidValueError, match="salt must have at least 16 bytes, got 5"):
        Isolation.of(None, handed(b"short"))
    with pytest.raises(InvalidValueError, match="salt must have at most 4096 bytes"):
        Isolation.of(None, handed(b"x" * 5000))
    with pytest.raises(InvalidValueError, match="salt: cannot read the open file 987"):
        Isolation.of(None, 987)
    with pytest.raises(InvalidValueError, match="budget_bytes must be None for policies in processes of their own"):
        benchmark(Grid(("late_fusion",), options={"budget_bytes": 400}), tmp_path, isolation=APART)
    command = ["bench", "--policies", "no_fusion", "--isolate", "--out", str(tmp_path)]
    assert main([*command, "--salt-fd", str(handed(b"short"))]) != 0
    assert "salt must have at least 16 bytes" in capsys.readouterr().err


def test_the_trust_of_a_defense_is_measured_in_a_process_of_its_own_too() -> None:
    spec = PolicySpec.parse("late_fusion(defense=plausibility)")
    options = {**OPTIONS, "attacks": {"cav_1": "pose_noise(position_m=9)"}}
    here = coopsim.evaluate(spec.make(), "crossing", seed=3, **options).score
    with APART.policy(spec) as policy:
        there = coopsim.evaluate(policy, "crossing", seed=3, **options).score
    names = ("attacker_TPR", "attacker_FPR", "attacker_AUC", "defense_passes", "sAMOTA")
    assert [there[name] for name in names] == [here[name] for name in names]
    assert np.isfinite([here[name] for name in names]).all()


@pytest.mark.parametrize("attack", all_of(["ghost", "remove", "pose_offset", "sybil"], "sybil"))
def test_a_lie_is_the_same_for_a_policy_in_a_process_of_its_own(attack: str) -> None:
    options = {**OPTIONS, "attacks": {"cav_1": attack}}
    with APART.policy(PolicySpec.parse("late_fusion")) as policy:
        there = coopsim.evaluate(policy, "crossing", seed=3, **options)
    here = coopsim.evaluate("late_fusion", "crossing", seed=3, **options)
    assert there.score.values == pytest.approx(dict(here.score.values), nan_ok=True) and there.messages == here.messages


def test_a_lie_in_content_of_another_process_is_refused() -> None:
    with (
        APART.policy(PolicySpec.parse("track_to_track")) as policy,
        pytest.raises(InvalidValueError, match=r"'ghost' lies in tracks before the codec.*in this process"),
    ):
        coopsim.evaluate(policy, "crossing", seed=3, **OPTIONS, attacks={"cav_1": "ghost"})


def test_trust_that_is_none_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "boasting.py"
    path.write_text(BOASTING)
    with (
        APART.policy(PolicySpec.parse(f"{path}:Policy")) as policy,
        pytest.raises(IsolatedPolicyError, match=r"no trust \(trust must be in \[0, 1\]"),
    ):
        coopsim.evaluate(policy, "crossing", seed=3, **OPTIONS)
