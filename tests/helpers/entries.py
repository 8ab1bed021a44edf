"""Tiny entries of the leaderboard, and the cheats that the board has to withstand."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from coopsim.bench.grid.grid_file import GridSource, find_grid

ABOUT = """\
name: {name}
policy: {policy}
authors: [A. Nother]
license: MIT
"""

CARD = """\
## Method

Drops <b>unsure</b> boxes.

## Source

Ours.

## Differences from the paper

None.

## Training and tuning

None.
"""

POLICY = """\
from dataclasses import dataclass

from coopsim.agents.boxes import LateFusion


@dataclass(kw_only=True, eq=False)
class MyTracker(LateFusion):
    least_score: float = 0.3

    def fuse(self, groups):
        return super().fuse([found[found.score >= self.least_score] for found in groups])
"""

MINE = "policy.py:MyTracker(least_score=0.4)"

SMALL: dict[str, Any] = {"vehicles": 6, "connected_cars": 1, "rsus": 1}
"""A town with two agents."""


def make_entry(folder: Path, policy: str = MINE, name: str = "mine", code: str = POLICY) -> Path:
    """Write an entry without scores."""
    folder.mkdir()
    (folder / "entry.yaml").write_text(ABOUT.format(name=name, policy=policy))
    (folder / "card.md").write_text(CARD)
    if ".py" in policy:
        (folder / "policy.py").write_text(code)
    return folder


def tiny_grid(name: str, **given: Any) -> GridSource:
    """Return two towns of five frames, without the preset's conditions but one."""
    small = {"seeds": (4000, 4001), "frames": 5, "losses": (0.1,), "position_noises_m": (0.2,), "latencies_ms": (0,)}
    return find_grid(name, **{**small, "heading_noises_deg": (0.2,), "options": SMALL, **given})


TWIN = """\
import coopsim
from coopsim.agents.boxes import LateFusion
from coopsim.support.rng import derived_seed

KNOWN = {derived_seed(seed, "policy"): seed for seed in range(3900, 4100)}

class P(LateFusion):
    twin = None

    def reset(self, specs, seed=0):
        super().reset(specs, seed=seed)
        self.twin, found = None, KNOWN.get(seed)
        if found is None:
            return
        env = coopsim.parallel_env("town", lidar=None, expose_ground_truth=True, uplink="none", detector="none",
                                   max_cycles=61, vehicles=6, connected_cars=1, rsus=1)
        self.o, self.i = env.reset(seed=found)
        if set(env.agent_specs) == set(specs):
            self.twin, self.t = env, coopsim.make_policy("truth")
            self.t.reset(env.agent_specs, seed=1)

    def act(self, observations, *a):
        if self.twin is None:
            return super().act(observations, *a)
        acts = self.t.act(self.o, self.i)
        self.o, _, _, _, self.i = self.twin.step(acts)
        return {name: acts[name] for name in observations}
"""
"""Tries small seeds until it has the town, and reports the truth of a twin of it."""

NEEDS = """\
import sys
import coopsim
from coopsim.agents.boxes import LateFusion
from coopsim.agents.truth import Truth

class P(LateFusion):
    _own, range_m, occluded = LateFusion.needs, 1000.0, True

    @property
    def needs(self):
        frame, names = sys._getframe(1), []
        while frame is not None:
            names.append(frame.f_code.co_name)
            frame = frame.f_back
        told = "evaluate" in names and names[0] in ("listening_env", "provided_env", "act_of", "act", "_evaluate")
        return coopsim.Needs(truth=True) if told else self._own

    @needs.setter
    def needs(self, value):
        self._own = value

    def track_all(self, observations):
        if all(each.truth is not None for each in observations.values()):
            return {name: Truth.track(self, name, each) for name, each in observations.items()}
        return super().track_all(observations)
"""
"""Says that it needs the truth only where the environment asks, and not where the check does."""

PATCH = (
    POLICY
    + """
import coopsim.bench.entries.entry_checks as checks
checks.differences = lambda *a: iter(())
checks._conformance = lambda *a: iter(())
"""
)
"""Rewrites its own check when it is imported."""

TELE = """\
from dataclasses import dataclass, replace
import numpy as np
from coopsim.agents.boxes import NoFusion
from coopsim.geometry.boxes import Boxes3D
from coopsim.types import Detections

@dataclass(kw_only=True, eq=False)
class P(NoFusion):
    def track_all(self, observations):
        return super().track_all({name: self.pooled(name, observations) for name in observations})

    def pooled(self, name, observations):
        mine = observations[name]
        if mine.time_ns < 200e6:
            return mine
        all_boxes, own = [], mine.pose.world_SE3_base.inverse()
        for each in observations.values():
            all_boxes.append(each.detections.boxes.transform(own.compose(each.pose.world_SE3_base)))
        found = [each.detections for each in observations.values()]
        return replace(mine, detections=Detections(
            Boxes3D.concatenate(all_boxes),
            np.concatenate([each.score for each in found]),
            np.concatenate([each.label for each in found]),
        ))
"""
"""Pools all agents' boxes in memory, beside the channel, after the first frames."""

SALT = """\
import glob, os
from dataclasses import dataclass
from coopsim.agents.boxes import LateFusion

def read(path):
    try:
        with open(path, "rb") as file:
            return file.read(10**6)
    except OSError:
        return b""

def found():
    looked = [b"".join(part for name in os.environb.items() for part in name)]
    for process in glob.glob("/proc/[0-9]*"):
        looked += [read(process + "/" + name) for name in ("cmdline", "environ")]
        try:
            looked += [read(f"{process}/fd/{name}") for name in os.listdir(process + "/fd")]
        except OSError:
            pass
    parent = os.getppid()
    for line in read(f"/proc/{parent}/maps").decode().splitlines():
        if "[heap]" in line:
            begin, end = (int(each, 16) for each in line.split()[0].split("-"))
            try:
                with open(f"/proc/{parent}/mem", "rb") as memory:
                    memory.seek(begin)
                    looked.append(memory.read(end - begin))
            except OSError:
                pass
    return [name for name in looked if b"0123456789abcdef" in name]

@dataclass(kw_only=True, eq=False)
class P(LateFusion):
    def begin(self, spec, rng):
        super().begin(spec, rng)
        if found():
            raise SystemExit("the salt was found")
"""
"""Looks for the salt in arguments, environments, open files and the memory of other processes."""
