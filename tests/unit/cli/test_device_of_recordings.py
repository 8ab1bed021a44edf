"""The option `--device` of `replay`, `leaderboard` and `clip`: networks compute there, and nothing else changes."""

from __future__ import annotations

from pathlib import Path

import pytest

pytest.importorskip("torch")

from fake_gpu import FakeGpu
from tiny_recordings import write_opv2v

from coopsim.cli import main

REPLAY, LEADERBOARD = ("replay",), ("leaderboard", "--out", "ranked")


@pytest.fixture
def recordings(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    monkeypatch.chdir(tmp_path)
    return str(write_opv2v(tmp_path) / "train")


@pytest.mark.parametrize(
    "typed",
    [
        (*REPLAY, "--policy", "fcooper"),
        pytest.param((*REPLAY, "--policy", "no_fusion"), marks=pytest.mark.long),
        pytest.param((*LEADERBOARD, "--policies", "fcooper,no_fusion"), marks=pytest.mark.long),
        pytest.param((*REPLAY, "--policy", "no_fusion", "--detector", "pillars"), marks=pytest.mark.long),
    ],
)
def test_networks_compute_on_the_device(
    typed: tuple[str, ...], recordings: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    with FakeGpu(monkeypatch) as gpu:
        assert main([typed[0], recordings, *typed[1:], "--device", "cuda", "--frames", "1"]) == 0
    assert gpu.layers > 0 and not gpu.elsewhere


@pytest.mark.parametrize("typed", [REPLAY, LEADERBOARD])
def test_another_device_is_refused(typed: tuple[str, ...], recordings: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main([typed[0], recordings, *typed[1:], "--device", "abacus"]) == 2
    assert "device must be cpu, cuda, cuda:1, ... or auto, got 'abacus'" in capsys.readouterr().err


def test_a_device_that_is_not_there_is_refused(recordings: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["replay", recordings, "--device", "cuda:7", "--frames", "1"]) == 2
    assert "cuda:7" in capsys.readouterr().err


def test_a_clip_is_run_on_the_device(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    met: list[str] = []

    def stop(grid: object, seeds: object) -> None:
        met.extend(getattr(grid, "policies"))  # noqa: B009
        raise KeyboardInterrupt

    monkeypatch.setattr("coopsim.bench.search_pair.search_pair", stop)
    typed = [
        "clip",
        "occluded_pedestrian",
        "--sharing",
        "attfuse",
        "--device",
        "cuda",
        "--out",
        str(tmp_path / "a.gif"),
    ]
    assert main(typed) == 130
    assert met == ["no_fusion", "attfuse(device=cuda)"]
