"""Installed packages add parts of every kind by name, through entry points: policies, detectors, codecs, fusions..."""

from __future__ import annotations

from pathlib import Path

import pytest
from fork_server import run_python

pytestmark = pytest.mark.usefixtures("started_anew")

PLUGIN = """
from coopsim.agents.boxes import LateFusion
from coopsim.comms.codecs.detection_codec import DetectionsCodec
from coopsim.comms.uplinks.share_detections import ShareDetections
from coopsim.detection.detector import NoDetector
from coopsim.detection.embedder import Embedder
from coopsim.envs import Reward
from coopsim.metrics.metric import Metric
from coopsim import Defense, Planner, Recorder, Trust
import numpy as np

class MyPolicy(LateFusion): pass
class MyDetector(NoDetector): pass
class MyUplink(ShareDetections): pass
class MyCodec(DetectionsCodec): pass
class MyEmbedder(Embedder):
    dim = 2
    def embed(self, detections, view):
        return np.ones((len(detections), 2))
class MyReward(Reward):
    def __init__(self, *, worth=1.0):
        self.worth = worth
    def __call__(self, counts):
        return self.worth
class MyPlanner(Planner):
    def plan(self, car):
        return -1.0
class MyDefense(Defense):
    def judge(self, reception):
        return Trust({})
class MyRecorder(Recorder):
    def begin(self, episode):
        self.steps = dict.fromkeys(episode.received, 0.0)
    def on_step(self, episode):
        self.steps = dict.fromkeys(self.steps, float(episode.steps))
    def records(self):
        return self.steps
class MyMetric(Metric):
    meaning, whole_only, recorders = "steps", True, ("mine",)
    def value(self, pool):
        return pool.records["mine"][0]
"""

ENTRY_POINTS = """
[coopsim.policies]
mine = plugged_in:MyPolicy
[coopsim.detectors]
mine = plugged_in:MyDetector
[coopsim.uplinks]
mine = plugged_in:MyUplink
[coopsim.codecs]
mine = plugged_in:MyCodec
[coopsim.embedders]
mine = plugged_in:MyEmbedder
[coopsim.metrics]
mine = plugged_in:MyMetric
broken = no_such_module:Metric
[coopsim.recorders]
mine = plugged_in:MyRecorder
[coopsim.defenses]
mine = plugged_in:MyDefense
[coopsim.planners]
mine = plugged_in:MyPlanner
[coopsim.rewards]
mine = plugged_in:MyReward
"""

PROGRAM = """
import sys
import warnings
import coopsim
from coopsim.catalog import POLICIES, REWARDS
from coopsim.comms.codecs.codec import CODECS
from coopsim.comms.uplinks.uplink import UPLINKS
from coopsim.interfaces.defense import DEFENSES
from coopsim.detection.detector import DETECTORS
from coopsim.detection.embedder import EMBEDDERS
from coopsim.episode import RECORDERS
from coopsim.metrics.built_in import custom_metrics
from coopsim.metrics.metric import METRICS
from coopsim.interfaces.planner import PLANNERS

told = []
warnings.simplefilter("always")
warnings.showwarning = lambda message, *_: told.append(str(message))
registries = [POLICIES, DETECTORS, UPLINKS, CODECS, EMBEDDERS, METRICS, RECORDERS, REWARDS, PLANNERS, DEFENSES]
for registry in registries:
    assert "mine" in registry.names(), registry.kind
assert "plugged_in" not in sys.modules  # names are known without loading anything
coopsim.parallel_env("crossing", lidar=None, control="planner", planner="mine")  # made at once
names = dict.fromkeys(["uplink", "codec", "detector", "embedder"], "mine")
env = coopsim.parallel_env("crossing", lidar=None, max_cycles=2, reward="mine(worth=3)", **names)
policy = coopsim.make_policy("mine", defense="mine")
observations, _ = env.reset(seed=0)
policy.reset(env.agent_specs)
names = CODECS.names()
assert {names[codec] for each in observations.values() for codec in each["inbox"]["codec"]} == {"mine"}
while env.agents:
    observations, rewards, *_ = env.step(policy.act(observations))
    assert set(rewards.values()) == {3}
score, _ = env.score(), env.score()
assert score["mine"] == 2.0 and "broken" not in score.values and list(custom_metrics()) == ["mine"]
(text,) = [each for each in told if "left out" in each]  # and it costs itself alone
assert text == (
    "metric 'broken' is left out: package 'plugged-in', entry point 'no_such_module:Metric' raised "
    "ModuleNotFoundError: No module named 'no_such_module'"
), text
for registry in registries:
    assert registry.get("mine").__module__ == "plugged_in", registry.kind
assert CODECS.name_of(CODECS.get("mine")) == "mine"
"""


FUSION = """
import torch
from coopsim.nn.fusion import FeatureFusion

class Weighted(FeatureFusion):
    def __init__(self, features, *, weight=1.0):
        super().__init__()
        self.weight = weight

    def fuse(self, own, own_mask, others, mask, context):
        return torch.maximum(own, self.weight * (others * mask[:, None]).amax(0))
"""

FUSION_POINTS = """
[coopsim.fusions]
mine = plugged_in:Weighted
"""

FUSION_PROGRAM = """
import sys
from coopsim.nn.cooperative.cooperative_net import CooperativeConfig, CooperativeNet
from coopsim.nn.fusion import FUSIONS

assert "mine" in FUSIONS.names() and "plugged_in" not in sys.modules
net = CooperativeNet.from_config(CooperativeConfig(fusion="mine", parameters={"weight": 0.5}))
assert net.fusion.weight == 0.5 and type(net.fusion).__module__ == "plugged_in"
"""


BACKBONE = """

class Mean(torch.nn.Conv2d):
    def __init__(self, width):
        super().__init__(3, width, 8, 8)

    def forward(self, pictures, geometry):
        return super().forward(pictures)
"""

BACKBONE_POINTS = """
[coopsim.backbones]
mine = plugged_in:Mean
"""

BACKBONE_PROGRAM = """
from coopsim.nn.camera.lift_splat import LiftSplatConfig, LiftSplatEncoder
from coopsim.nn.camera.picture_net import BACKBONES

assert "mine" in BACKBONES.names()
backbone = LiftSplatEncoder(LiftSplatConfig(backbone="mine", width=5)).pictures.net.backbone
assert backbone.out_channels == 5 and type(backbone).__module__ == "plugged_in"
"""


def test_entry_points_add_to_every_registry_and_one_that_is_broken_costs_itself_alone(tmp_path: Path) -> None:
    _plug_in(tmp_path, PLUGIN, ENTRY_POINTS)
    _run(tmp_path, PROGRAM)


def test_entry_points_add_fusions_and_backbones(tmp_path: Path) -> None:
    pytest.importorskip("torch")
    _plug_in(tmp_path, FUSION + BACKBONE, FUSION_POINTS + BACKBONE_POINTS)
    _run(tmp_path, FUSION_PROGRAM + BACKBONE_PROGRAM)


def _plug_in(folder: Path, module: str, entry_points: str) -> None:
    """Install a package in a folder."""
    (folder / "plugged_in.py").write_text(module)
    info = folder / "plugged_in-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: plugged-in\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text(entry_points)


def _run(folder: Path, program: str) -> None:
    """Run a program that finds the packages in a folder."""
    done = run_python(program, found=folder)
    assert done.returncode == 0, done.stderr
