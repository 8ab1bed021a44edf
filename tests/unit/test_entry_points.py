"""Installed packages add policies, detectors, embedders, uplinks, codecs and metrics by name, through entry points."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

PLUGIN = """
from coopsim.agents.late_fusion import LateFusion
from coopsim.comms.codecs.detection_codec import DetectionsCodec
from coopsim.comms.uplinks.share_detections import ShareDetections
from coopsim.detection.detector import NoDetector
from coopsim.detection.embedder import Embedder
from coopsim.metrics.metric import Metric
import numpy as np

class MyPolicy(LateFusion): pass
class MyDetector(NoDetector): pass
class MyUplink(ShareDetections): pass
class MyCodec(DetectionsCodec): pass
class MyEmbedder(Embedder):
    dim = 2
    def embed(self, detections, view):
        return np.ones((len(detections), 2))
class MyMetric(Metric):
    meaning = "one"
    def value(self, pool):
        return 1.0
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
"""

PROGRAM = """
import sys
import coopsim
from coopsim.catalog import POLICIES
from coopsim.comms.codecs.codec import CODECS
from coopsim.comms.uplinks.uplink import UPLINKS
from coopsim.detection.detector import DETECTORS
from coopsim.detection.embedder import EMBEDDERS
from coopsim.metrics.metric import METRICS

registries = [POLICIES, DETECTORS, UPLINKS, CODECS, EMBEDDERS, METRICS]
for registry in registries:
    assert "mine" in registry.names(), registry.kind
assert "plugged_in" not in sys.modules  # names are known without loading anything
names = dict.fromkeys(["uplink", "codec", "detector", "embedder"], "mine")
env = coopsim.parallel_env("crossing", lidar=None, max_cycles=2, **names)
policy = coopsim.make_policy("mine")
observations, _ = env.reset(seed=0)
policy.reset(env.agent_specs)
names = CODECS.names()
assert {names[codec] for each in observations.values() for codec in each["inbox"]["codec"]} == {"mine"}
while env.agents:
    observations, *_ = env.step(policy.act(observations))
assert env.score()["mine"] == 1.0
for registry in registries:
    assert registry.get("mine").__module__ == "plugged_in", registry.kind
assert CODECS.name_of(CODECS.get("mine")) == "mine"
"""


def test_entry_points_add_to_every_registry(tmp_path: Path) -> None:
    (tmp_path / "plugged_in.py").write_text(PLUGIN)
    folder = tmp_path / "plugged_in-1.0.dist-info"
    folder.mkdir()
    (folder / "METADATA").write_text("Metadata-Version: 2.1\nName: plugged-in\nVersion: 1.0\n")
    (folder / "entry_points.txt").write_text(ENTRY_POINTS)
    paths = os.pathsep.join([str(tmp_path), *(path for path in sys.path if path)])
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM],
        capture_output=True,
        text=True,
        check=False,
        env=os.environ | {"PYTHONPATH": paths},
    )
    assert done.returncode == 0, done.stderr
