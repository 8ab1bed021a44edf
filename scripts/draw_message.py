"""Draw what a message is: the sent boxes, the messages on their way, and what the receiver makes of them.

    python scripts/draw_message.py [--out docs/learn/message.svg]

All is of one episode of `occluded_crossing` with `late_fusion`: messages are late, some are lost, poses are estimated.
The pair and the frame are the first in which a received box shows a moving object that the receiver does not detect.
"""

from __future__ import annotations

import argparse
from collections import defaultdict
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

import coopsim
from coopsim.comms.codecs.codec import decoder
from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.se3 import SE3
from coopsim.support.files import write_whole
from coopsim.types import Detections, Message, Observation, PointCloud, Tracks
from coopsim.viz.charts import to_svg

PAGE = Path(__file__).parents[1] / "docs" / "learn" / "message.svg"
EPISODE: dict[str, Any] = {"latency_s": 0.3, "loss": 0.3, "position_noise_m": 0.2, "max_cycles": 60}
SEED, FIRST_FRAME, WINDOW_S, HALF_M = 4, 20, 1.5, 45.0
HIDDEN_M, MOVED_M, NOBODY = 4.0, 1.5, -1
OWN, SENT, MOVED, TRACK, TRUTH = "#4c78a8", "#f58518", "#e45756", "#2a9d5c", "#999999"


@dataclass(frozen=True)
class Scene:
    """A receiver's frame in which a message tells of something hidden, and the frames before."""

    receiver: str
    message: Message
    seen: Observation
    tracks: Tracks
    sent: Observation
    truth: Mapping[str, Any]
    truth_then: Mapping[str, Any]
    sends: dict[str, list[int]]
    arrivals: dict[str, dict[int, int]]

    @property
    def base_SE3_sender(self) -> SE3:
        """The sender at capture, in the receiver's frame now, by both estimated poses."""
        return self.seen.pose.world_SE3_base.inverse().compose(self.message.pose.world_SE3_base)


def find_scene() -> Scene:
    """Play the episode until a message tells its receiver of a moving object that it does not see."""
    scenes, policy = Scenes(), coopsim.make_policy("late_fusion")
    env = coopsim.parallel_env("occluded_crossing", uplink=policy, expose_ground_truth=True, **EPISODE)
    coopsim.run_episode(env, policy, [scenes], seed=SEED)
    if scenes.first is None:
        raise SystemExit("no message of this episode tells of a hidden object")
    return scenes.first


class Scenes(coopsim.Recorder):
    """The first scene of an episode in which a message tells of a hidden object."""

    def __init__(self) -> None:
        self.first: Scene | None = None
        self._past: dict[tuple[str, int], tuple[Observation, Any]] = {}
        self._sends: dict[str, list[int]] = defaultdict(list)
        self._arrivals: dict[str, dict[str, dict[int, int]]] = defaultdict(lambda: defaultdict(dict))

    def on_report(self, episode: coopsim.Episode) -> None:
        if self.first is not None:
            return
        for agent, seen in episode.received.items():
            self._past[agent, seen.time_ns] = seen, episode.infos[agent]["ground_truth"]
            self._sends[agent].append(seen.time_ns)
            for message in seen.inbox:
                self._arrivals[agent][message.sender][message.captured_ns] = seen.time_ns
        if episode.steps >= FIRST_FRAME:
            self.first = next((each for each in self._scenes(episode) if told(each) is not None), None)

    def _scenes(self, episode: coopsim.Episode) -> Iterator[Scene]:
        for agent, seen in sorted(episode.received.items()):
            truth, tracks = episode.infos[agent]["ground_truth"], episode.tracks[agent]
            for message in seen.inbox if agent.startswith("cav") else ():
                sent, then = self._past[message.sender, message.captured_ns]
                yield Scene(agent, message, seen, tracks, sent, truth, then, self._sends, self._arrivals[agent])


def received(scene: Scene) -> Boxes3D:
    """Return the boxes of the message in the receiver's frame, where the objects were at capture."""
    return contents(scene).boxes.transform(scene.base_SE3_sender)


def told(scene: Scene) -> tuple[int, int] | None:
    """Return the rows of the track and of the sent box of a moving object that the receiver's own boxes lack."""
    at, old = scene.tracks.boxes.center, received(scene).center
    sent, own = contents(scene).boxes.center, scene.seen.detections.boxes.center
    for row, now in enumerate(ids(at, scene.truth)):
        for column, then in enumerate(ids(sent, scene.truth_then)):
            moved = np.linalg.norm(at[row, :2] - old[column, :2]) > MOVED_M
            in_view = max(np.abs(at[row]).max(), np.abs(sent[column]).max()) < HALF_M - 5
            if now == then != NOBODY and moved and in_view and gaps(at[row : row + 1], own).min() > HIDDEN_M:
                return row, column
    return None


def gaps(centers: Any, others: Any) -> Any:
    """Return the distances (N, M) over ground of places; of none, infinity in one column."""
    none = np.full((len(centers), 1), np.inf)
    return np.hstack([none, np.linalg.norm(centers[:, None, :2] - others[None, :, :2], axis=2)])


def ids(centers: Any, truth: Mapping[str, Any]) -> Any:
    """Return the ids (N,) of the true objects within a metre of places; `NOBODY` where there is none."""
    near = gaps(centers, truth["box"])
    return np.where(near.min(axis=1) < 1.0, np.append(NOBODY, truth["id"])[near.argmin(axis=1)], NOBODY)


def contents(scene: Scene) -> Detections:
    """Return what the message says, in the sender's frame at capture."""
    said: Detections = decoder(scene.message.codec).decode(scene.message.payload)
    return said


def ring(panel: Any, center: Any) -> None:
    """Mark the object that the receiver does not detect itself."""
    style = {"markersize": 26, "fillstyle": "none", "color": MOVED, "markeredgewidth": 1.6}
    panel.plot([center[0]], [center[1]], "o", **style)


def scatter(panel: Any, seen: Observation) -> None:
    """Draw a quarter of an agent's points, from above."""
    for sweep in seen.sweeps.values():
        panel.plot(*PointCloud.of(sweep).xyz[::4, :2].T, ",", color=TRUTH, alpha=0.6, rasterized=True)


def outline(panel: Any, boxes: Boxes3D, color: str, **style: Any) -> None:
    """Draw boxes from above, the front marked by a line from the middle."""
    label = style.pop("label", None)
    for number, (corners, center) in enumerate(zip(boxes.corners[:, :4, :2], boxes.center[:, :2], strict=True)):
        closed = np.vstack([corners, corners[:1]])
        panel.plot(*closed.T, color=color, label=None if number else label, **style)
        panel.plot(*np.array([center, corners[[0, 3]].mean(axis=0)]).T, color=color, **style | {"linestyle": "-"})


def draw_sent(panel: Any, scene: Scene) -> None:
    """Draw the sender's points and the boxes that it sends."""
    scatter(panel, scene.sent)
    outline(panel, scene.sent.detections.boxes, SENT, linewidth=1.3)
    _, column = told(scene) or (0, 0)
    ring(panel, contents(scene).boxes.center[column])
    count, size = len(scene.sent.detections), len(scene.message.payload)
    panel.set_title(
        f"1  sent: {scene.message.sender} at {scene.message.captured_ns / 1e9:.1f} s\n"
        f"{count} boxes, {size} bytes, and its pose"
    )


def draw_channel(panel: Any, scene: Scene) -> None:
    """Draw each broadcast from its capture to its arrival at the receiver; a cross: it was lost."""
    now = scene.seen.time_ns
    senders = [name for name in scene.sends if name != scene.receiver]
    late_ns = EPISODE["latency_s"] * 1e9
    for row, sender in enumerate(senders):
        for captured in scene.sends[sender]:
            if captured < now - WINDOW_S * 1e9:
                continue
            arrival, x = scene.arrivals[sender].get(captured), captured / 1e9
            chosen = sender == scene.message.sender and captured == scene.message.captured_ns
            color = MOVED if chosen else SENT
            if arrival is not None:
                panel.annotate(
                    "",
                    (arrival / 1e9, row + 0.3),
                    (x, row - 0.3),
                    arrowprops={"arrowstyle": "->", "color": color, "lw": 2 if chosen else 0.9},
                )
            elif captured + late_ns <= now:
                panel.plot([x], [row - 0.3], "x", color="black")
            else:
                panel.plot([x, now / 1e9], [row - 0.3, row - 0.3 + 0.6 * (now - captured) / late_ns], ":", color=SENT)
    panel.axvline(now / 1e9, color=TRACK, linewidth=1)
    panel.set(
        yticks=range(len(senders)),
        yticklabels=senders,
        xlabel="time, s",
        xlim=((now - WINDOW_S * 1e9) / 1e9 - 0.1, now / 1e9 + 0.1),
        ylim=(-0.7, len(senders) - 0.3),
    )
    panel.set_title(
        f"2  on its way: {EPISODE['latency_s'] * 1000:.0f} ms late\nx lost, dotted: not there yet, line: now"
    )


def draw_made(panel: Any, scene: Scene) -> None:
    """Draw what the receiver has: the truth, its own boxes, those of the message, and its tracks."""
    scatter(panel, scene.seen)
    outline(panel, Boxes3D.from_array(scene.truth["box"]), TRUTH, linewidth=3.5, alpha=0.5, label="truth")
    outline(panel, scene.seen.detections.boxes, OWN, linewidth=1.1, label="its own boxes")
    outline(panel, received(scene), SENT, linewidth=1.1, linestyle="--", label="received, as captured")
    outline(panel, scene.tracks.boxes, TRACK, linewidth=1.3, label="its tracks")
    row, _ = told(scene) or (0, 0)
    ring(panel, scene.tracks.boxes.center[row])
    panel.legend(loc="upper right", fontsize=7)
    panel.set_title(
        f"3  made of it: {scene.receiver} at {scene.seen.time_ns / 1e9:.1f} s\ncircle: not among its own boxes"
    )


def draw(scene: Scene) -> str:
    """Return the picture."""

    def panels(figure: Any) -> None:
        left, middle, right = figure.subplots(1, 3, width_ratios=(1, 0.8, 1))
        draw_sent(left, scene)
        draw_channel(middle, scene)
        draw_made(right, scene)
        for panel in (left, right):
            panel.set(
                xlim=(-HALF_M, HALF_M), ylim=(-HALF_M, HALF_M), aspect="equal", xlabel="ahead, m", ylabel="left, m"
            )
            panel.plot([0], [0], marker=">", color="black", markersize=7)

    return to_svg(panels, 12, 4.6)


def main() -> None:
    """Find the scene and write the picture."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=PAGE)
    out = parser.parse_args().out
    print(f"written: {write_whole(out, draw(find_scene()))}")


if __name__ == "__main__":
    main()
