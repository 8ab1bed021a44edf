"""Clips by Ray: in order, made ahead, and given up when they are not wanted any more; with a Ray of no processes."""

from __future__ import annotations

from typing import Any

import pytest
from synthetic_clips import SyntheticClips

from coopsim.learn.clips import clips_on_ray
from coopsim.learn.clips.clips_on_ray import ClipsOnRay


class Remote:
    def __init__(self, function: Any, started: list[int]) -> None:
        self._function, self._started = function, started

    def remote(self, source: Any, index: int) -> tuple[int, Any]:
        self._started.append(index)
        return index, self._function(source, index)


class FakeRay:
    """Of Ray what is used; everything is made at once."""

    def __init__(self) -> None:
        self.running, self.started, self.cancelled = False, list[int](), list[int]()

    def is_initialized(self) -> bool:
        return self.running

    def remote(self, **options: Any) -> Any:
        assert options["num_cpus"] == 1
        return lambda function: Remote(function, self.started)

    def put(self, value: Any) -> Any:
        return value

    def get(self, reference: tuple[int, Any]) -> Any:
        return reference[1]

    def cancel(self, reference: tuple[int, Any]) -> None:
        self.cancelled.append(reference[0])

    def shutdown(self) -> None:
        self.running = False


@pytest.fixture
def ray(monkeypatch: pytest.MonkeyPatch) -> FakeRay:
    fake = FakeRay()
    monkeypatch.setattr(clips_on_ray, "import_ray", lambda: fake)
    monkeypatch.setattr(clips_on_ray, "start_ray", lambda ray, workers, address: setattr(fake, "running", True))
    return fake


def test_clips_are_made_ahead_once_and_in_order(ray: FakeRay) -> None:
    source = SyntheticClips(frames=1)
    with ClipsOnRay(source, 3) as clips:
        keys = [clips.clip(index).key for index in (4, 5, 9)]
    assert keys == [source.clip(index).key for index in (4, 5, 9)]
    assert ray.started == [4, 5, 6, 7, 9, 10, 11] and ray.cancelled == [6, 7, 10, 11]
    assert not ray.running


def test_a_ray_of_the_caller_is_left_running(ray: FakeRay) -> None:
    ray.running = True
    with ClipsOnRay(SyntheticClips(frames=1), 1) as clips:
        clips.clip(0)
    assert ray.running
