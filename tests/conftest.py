"""What several tests share: small environments, small recordings, and the path of the real ones."""

from __future__ import annotations

import gc
import os
from collections.abc import Callable, Generator
from pathlib import Path
from typing import Any

import pytest
from fork_server import quick_starts, started_anew  # noqa: F401  (fixtures)
from held_times import HeldTimes
from hypothesis import HealthCheck, settings
from jobs_here import jobs_here  # noqa: F401  (a fixture)
from order import slow_first
from short_episode import folder_bytes, short_episode  # noqa: F401  (fixtures)
from small_env import SMALL
from without_curves import without_curves  # noqa: F401  (a fixture)

import coopsim
from coopsim.comms.channel import channel
from coopsim.comms.envelope import encode_message
from coopsim.types import Message

# How fast examples are drawn and run is the machine's affair: a busy one is no failure.
PATIENT: dict[str, Any] = {"deadline": None, "suppress_health_check": [HealthCheck.too_slow]}
settings.register_profile("patient", max_examples=40, **PATIENT)
settings.register_profile("thorough", max_examples=200, **PATIENT)  # of `make check-long`
settings.load_profile("patient")


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--hold-times", action="store_true", help="fail tests that compute for longer than tests may")
    parser.addoption("--start-anew", action="store_true", help="start workers as users' are, not by a fork")


def pytest_configure(config: pytest.Config) -> None:
    if config.getoption("hold_times"):
        config.pluginmanager.register(HeldTimes())


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Generator[None, object, object]:
    """Search neither for cycles among all that is imported and collected, nor in it later: it stays to the end."""
    gc.disable()
    try:
        return (yield)
    finally:
        gc.freeze()
        gc.enable()


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    items[:] = slow_first(items)


@pytest.fixture
def make_small() -> Callable[..., Any]:
    """Make a small environment; keywords override `SMALL`."""

    def make(name: str = "crossing", **options: Any) -> Any:
        return coopsim.parallel_env(name, **(SMALL | options))

    return make


@pytest.fixture
def recordings(tmp_path: Path) -> Path:
    """Two sequences, two detection names: one car that drives ahead at 10 m/s, seen by both."""
    for sequence, frames in (("0000", 6), ("0001", 4)):
        labels, found = [], []
        for k in range(frames):
            z = 10.0 + k
            labels.append(f"{k} 7 Car 0 0 0 0 0 0 0 1.6 1.9 4.5 2.0 1.0 {z} -1.5707963")
            found.append(f"{k},2,0,0,0,0,0.9,1.6,1.9,4.5,2.0,1.0,{z},-1.5707963,0.0")
        _write(tmp_path / "labels" / f"{sequence}.txt", labels)
        for name in ("ego", "1"):
            _write(tmp_path / "detections" / name / f"{sequence}.txt", found)
    return tmp_path


@pytest.fixture
def v2v4real() -> Path:
    """The real recordings, where the user has them."""
    root = os.environ.get("COOPSIM_DATA")
    if root is None:
        pytest.skip("needs recordings: set COOPSIM_DATA to a folder that contains v2v4real/val")
    path = Path(root) / "v2v4real" / "val"
    if not path.is_dir():
        pytest.skip(f"needs recordings: COOPSIM_DATA is {root}, which has no v2v4real/val")
    return path


@pytest.fixture
def sizes(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """The bytes of each message on the air."""
    seen: list[int] = []

    def count(message: Message) -> bytes:
        wire = encode_message(message)
        seen.append(len(wire))
        return wire

    monkeypatch.setattr(channel, "encode_message", count)
    return seen


def _write(path: Path, lines: list[str]) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("\n".join(lines) + "\n")
