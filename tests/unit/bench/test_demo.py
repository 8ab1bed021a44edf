"""The demonstration as a library call."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from small_env import SMALL

from coopsim.bench.demo import Demo, DemoConfig
from coopsim.errors import EpisodeStateError, InvalidValueError, UnknownNameError

OPTIONS = {name: value for name, value in SMALL.items() if name != "max_cycles"}


def config(**change: Any) -> DemoConfig:
    return DemoConfig(**({"policies": ("no_fusion",), "latencies_s": (0.0,), "frames": 3, "options": OPTIONS} | change))


def test_settings_say_what_was_run(tmp_path: Path) -> None:
    demo = Demo(config(options=OPTIONS | {"false_positives": "ignore", "control": "policy", "loss": 1 / 3}))
    demo.run(lambda: None)
    text = demo.write_report(tmp_path / "report.html").read_text()
    for name, value in {
        "false positives": "ignored",
        "control": "policy",
        "loss": "0.3333",
        "frames": "3 at 10 Hz",
        "vehicles": "10",
    }.items():
        assert f"<dt>{name}</dt><dd>{value}</dd>" in text


def test_runs_that_an_interrupt_leaves_are_reported(tmp_path: Path) -> None:
    demo = Demo(config(policies=("no_fusion", "late_fusion"), latencies_s=(0.0, 0.0004)))
    frames = 0

    def interrupt() -> None:
        nonlocal frames
        frames += 1
        if frames == 8:  # in the third run
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        demo.run(interrupt)
    assert [run.about for run in demo.runs] == [
        {"policy": "no_fusion", "latency": "0 ms"},
        {"policy": "no_fusion", "latency": "0.4 ms"},
    ]
    assert all(len(run.tracks) == run.evaluation.frames == 3 for run in demo.runs)
    assert "3 frames each: 2 runs finished" in demo.write_report(tmp_path / "report.html").read_text()


@pytest.mark.parametrize(
    ("change", "error", "match"),
    [
        ({"policies": ("no_fusion", "late_fusoin")}, UnknownNameError, "Did you mean 'late_fusion'"),
        ({"latencies_s": (0.0, -0.1)}, InvalidValueError, "latency_s must be"),
    ],
)
def test_a_typo_in_the_last_costs_nothing_before_it(change: Any, error: type[Exception], match: str) -> None:
    with pytest.raises(error, match=match):
        Demo(config(**change))


def test_nothing_to_report_yet(tmp_path: Path) -> None:
    with pytest.raises(EpisodeStateError, match="nothing has been run yet"):
        Demo(config()).write_report(tmp_path / "report.html")
    assert list(tmp_path.iterdir()) == []
