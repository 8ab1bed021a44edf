"""Logs and curves of trainings."""

import os
from pathlib import Path

import pytest

from coopsim.errors import InvalidValueError
from coopsim.learn.loop.training_log import LOG, TrainingLog, read_log, write_curves


def test_lines_after_the_checkpoint_come_again(tmp_path: Path) -> None:
    log = TrainingLog(tmp_path, 0)
    for step in range(1, 8):
        log.add(step, {"loss": 1 / step, "heat": 0.5})
    log.add(7, {"AP@0.5": 0.25}, kind="validation")
    log.write()
    again = TrainingLog(tmp_path, 5)
    again.add(6, {"loss": 9.0, "heat": 0.5})
    again.write()
    assert [(line["step"], line["loss"]) for line in read_log(tmp_path)][-2:] == [(5, 0.2), (6, 9.0)]
    TrainingLog(tmp_path, 0).write()
    assert read_log(tmp_path) == []


def test_a_log_is_on_the_disk_as_the_checkpoint_is(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    synced: list[str] = []
    monkeypatch.setattr(os, "fsync", lambda handle: synced.append(os.readlink(f"/proc/self/fd/{handle}")))
    TrainingLog(tmp_path, 0).write()
    assert len(synced) == 2 and synced[1] == str(tmp_path)


def test_a_broken_line_is_named(tmp_path: Path) -> None:
    (tmp_path / LOG).write_text('{"step": 1, "kind": "losses", "loss": 1}\n[]\n')
    with pytest.raises(InvalidValueError, match=r"log.jsonl:2: this is no line"):
        read_log(tmp_path)


def test_curves_are_the_same_for_the_same_log_and_take_any(tmp_path: Path) -> None:
    log = TrainingLog(tmp_path, 0)
    log.write()
    assert "<svg" in write_curves(tmp_path).read_text()
    for step in range(1, 1000):
        log.add(step, {"loss": 1 / step, "variance": -0.5})
    log.add(999, {"AP@0.5": 0.25}, kind="validation")
    log.write()
    first = write_curves(tmp_path).read_bytes()
    assert first == write_curves(tmp_path).read_bytes() and len(first) < 100_000
    assert b"losses that may be negative" in first and b"held-out places" in first and b"mathdefault" not in first
