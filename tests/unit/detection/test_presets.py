"""Detectors by name, from files and in environments."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import coopsim
from coopsim.detection.detector import DETECTORS
from coopsim.detection.presets import FITTED, make_detector, preset, read_config
from coopsim.detection.simulated.correlated import CorrelatedDetector
from coopsim.detection.simulated.simulated import SimulatedDetector
from coopsim.errors import InvalidValueError, ScenarioFileError, UnknownNameError
from coopsim.types import Tracks
from coopsim.wire.actions import pack_tracks

NAME = "pointpillars_v2v4real"


def boxes_over(frames: int, **options: object) -> list[np.ndarray]:
    env = coopsim.parallel_env("highway", vehicles=12, max_cycles=frames, lidar=None, **options)
    observations, _ = env.reset(seed=2)
    seen = [observations["cav_0"]["detections"]["box"]]
    while env.agents:
        observations, *_ = env.step({name: {"tracks": pack_tracks(Tracks.empty())} for name in env.agents})
        seen.append(observations["cav_0"]["detections"]["box"])
    assert any(map(len, seen))
    return seen


def test_names() -> None:
    assert isinstance(make_detector("simulated"), SimulatedDetector)
    assert isinstance(make_detector(NAME), CorrelatedDetector)
    assert set(DETECTORS.names()) >= {"simulated", NAME}


@pytest.mark.parametrize("look_up", [make_detector, preset])
def test_an_unknown_name_lists_close_ones(look_up) -> None:  # type: ignore[no-untyped-def]
    with pytest.raises(UnknownNameError, match=NAME):
        look_up("pointpillars_v2v4rael")


@pytest.mark.parametrize(
    ("change", "error", "match"),
    [
        (("reach_x_m", "reach_x"), UnknownNameError, "reach_x_m"),
        (("lasting_s", "lasts_s"), UnknownNameError, "lasting_s"),
        (("reach_x_m: ", "reach_x_m: x"), InvalidValueError, "reach_x_m must be a finite number > 0"),
        (
            ("detection:", "detection: 3\nx:"),
            (UnknownNameError, InvalidValueError),
            "x|DetectionModel must be a mapping",
        ),
        (("reach_x_m:", "[: x"), InvalidValueError, r"detector: .*broken.yaml:\d+: this is no YAML"),
    ],
)
def test_a_broken_file_is_refused(tmp_path: Path, change: tuple[str, str], error: type[Exception], match: str) -> None:
    file = tmp_path / "broken.yaml"
    file.write_text((FITTED / f"{NAME}.yaml").read_text().replace(*change))
    with pytest.raises(error, match=match):
        read_config(file)


def test_by_name_in_an_environment_and_the_same_bits_again() -> None:
    first, again = (boxes_over(4, detector=NAME) for _ in range(2))
    for one, two in zip(first, again, strict=True):
        np.testing.assert_array_equal(one, two)
    assert sum(map(len, first)) > 0


def test_the_default_is_the_fitted_one() -> None:
    for one, two in zip(boxes_over(3), boxes_over(3, detector=NAME), strict=True):
        np.testing.assert_array_equal(one, two)
    assert any(
        len(one) != len(two) for one, two in zip(boxes_over(3), boxes_over(3, detector="simulated"), strict=True)
    )


def test_a_spec_sets_parameters() -> None:
    detector = make_detector("simulated(max_recall=0.5, min_points=3)")
    assert isinstance(detector, SimulatedDetector) and detector.config.max_recall == 0.5
    quiet = make_detector(f"{NAME}(clutter=None, confusion=None, reach_x_m=50)")
    assert isinstance(quiet, CorrelatedDetector)
    assert quiet.config == replace(preset(NAME), clutter=None, confusion=None, reach_x_m=50)
    with pytest.raises(UnknownNameError, match=r"unknown parameter 'recall' of detector 'simulated'"):
        make_detector("simulated(recall=1)")
    with pytest.raises(InvalidValueError, match=r"max_recall must be in \[0, 1\]"):
        coopsim.parallel_env("highway", detector="simulated(max_recall=2)")


def test_another_agent_shifts_nobodys_noise() -> None:
    few, many = (boxes_over(3, detector=NAME, connected_cars=count, rsus=0) for count in (1, 3))
    for one, two in zip(few, many, strict=True):
        np.testing.assert_array_equal(one, two)


def test_played_back_it_detects_the_same(tmp_path: Path) -> None:
    file = tmp_path / "run.coopsim"
    first, played = (boxes_over(3, detector=NAME, **{how: file}) for how in ("record", "playback"))
    for one, two in zip(first, played, strict=True):
        np.testing.assert_array_equal(one, two)


def test_an_environment_refuses_what_is_no_detector() -> None:
    with pytest.raises(UnknownNameError, match="unknown detector 'pointpilars'"):
        coopsim.parallel_env("highway", detector="pointpilars")
    with pytest.raises(InvalidValueError, match="detector must be a coopsim Detector or None"):
        coopsim.parallel_env("highway", detector=3)


def test_by_name_in_a_scenario_file(tmp_path: Path) -> None:
    file = tmp_path / "mine.yaml"
    file.write_text(f"scenario: highway\noptions:\n  detector: {NAME}\n  lidar: null\n")
    coopsim.parallel_env(file).close()
    file.write_text("scenario: highway\noptions:\n  detector: pointpilars\n")
    with pytest.raises(ScenarioFileError, match=r"mine.yaml:3: unknown detector 'pointpilars'"):
        coopsim.parallel_env(file)
