"""Recordings of cars on straight ways, seen by an agent that measures well and one that does not, and is less sure."""

from __future__ import annotations

from pathlib import Path

import numpy as np

SHARP_M, BLURRED_M = 0.05, 0.6


def write_recordings(folder: Path, names: tuple[str, ...] = ("0001", "0002"), frames: int = 24, cars: int = 4) -> Path:
    """Write recordings in KITTI's axes with the detections `ego`, off by `SHARP_M`, and `1`, by `BLURRED_M`."""
    for number, name in enumerate(names):
        rng = np.random.default_rng(number)
        lines: dict[str, list[str]] = {"labels": [], "ego": [], "1": []}
        speed = rng.uniform(-1.0, 1.0, cars)
        for k in range(frames):
            for car in range(cars):
                place = np.array([8.0 * car - 12.0, 1.0, 15.0 + speed[car] * k])
                lines["labels"].append(f"{k} {car} Car 0 0 0 0 0 0 0 1.6 1.9 4.5 {_text(place, ' ')} -1.5707963")
                for agent, sigma_m, score in (("ego", SHARP_M, 0.9), ("1", BLURRED_M, 0.4)):
                    seen = place + rng.normal(scale=sigma_m, size=3)
                    lines[agent].append(f"{k},2,0,0,0,0,{score},1.6,1.9,4.5,{_text(seen, ',')},-1.5707963,0.0")
        for kind, path in (("labels", "labels"), ("ego", "detections/ego"), ("1", "detections/1")):
            file = folder / path / f"{name}.txt"
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_text("\n".join(lines[kind]) + "\n")
    return folder


def _text(place: np.ndarray, between: str) -> str:
    return between.join(f"{number:.4f}" for number in place)
