"""Built-in detectors and embedders by name. Detectors fitted to recordings are YAML files (`fitted/*.yaml`)."""

from __future__ import annotations

from dataclasses import fields
from functools import cache, partial
from pathlib import Path
from typing import Any

from coopsim.config.load import load, read_mapping
from coopsim.config.spec import instantiate, parse_spec
from coopsim.detection.detector import DETECTORS, DetectorBase
from coopsim.detection.simulated.correlated import CorrelatedDetector, CorrelatedDetectorConfig
from coopsim.detection.simulated.simulated import SimulatedDetector, SimulatedDetectorConfig
from coopsim.errors import UnknownNameError

FITTED = Path(__file__).parent / "fitted"
"""Folder of the fitted detectors' parameters."""

DEFAULT_DETECTOR = "pointpillars_v2v4real"
"""Name of the detector of environments that are given none."""


def make_detector(spec: str) -> DetectorBase:
    """Make a detector by its name or spec, such as `simulated` or `simulated(max_recall=0.9)`.

    The parameters of the simulated detectors are the fields of their configurations.

    Raises:
        UnknownNameError: no such detector or parameter; the message lists the close ones.
        InvalidValueError: the spec has another shape, or a value is not accepted.
    """
    name, parameters = parse_spec("detector", spec)
    return instantiate("detector", name, DETECTORS.get(name), parameters)


def preset(name: str) -> CorrelatedDetectorConfig:
    """Return the parameters of the fitted detector called `name`, to be changed by `dataclasses.replace`.

    Raises:
        UnknownNameError: no such fitted detector; the message lists the close ones.
    """
    known = [path.stem for path in FITTED.glob("*.yaml")]
    if name not in known:
        raise UnknownNameError("fitted detector", name, known)
    return _fitted(name)


@cache
def _fitted(name: str) -> CorrelatedDetectorConfig:
    return read_config(FITTED / f"{name}.yaml")


def read_config(path: Path) -> CorrelatedDetectorConfig:
    """Read a configuration from a YAML file, whose keys are the fields of `CorrelatedDetectorConfig` and its parts."""
    content = read_mapping("detector", "a CorrelatedDetectorConfig", path)
    config: CorrelatedDetectorConfig = load(CorrelatedDetectorConfig, content, "detector")
    return config


def _make_simulated(**parameters: Any) -> DetectorBase:
    """Simulate a detector whose errors are independent from frame to frame, by numbers that are given."""
    return SimulatedDetector(instantiate("detector", "simulated", SimulatedDetectorConfig, parameters))


def _make_fitted(name: str, /, **parameters: Any) -> DetectorBase:
    """Simulate a detector whose errors are correlated in time, by numbers that were fitted to a real one."""
    fitted = preset(name)
    given = {field.name: getattr(fitted, field.name) for field in fields(fitted)}
    return CorrelatedDetector(instantiate("detector", name, CorrelatedDetectorConfig, given | parameters))


DETECTORS.register("simulated")(_make_simulated)
for _file in sorted(FITTED.glob("*.yaml")):
    DETECTORS.register(_file.stem)(partial(_make_fitted, _file.stem))
