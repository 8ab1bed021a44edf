"""A clip of a pair for a talk: the same seed without and with messages, side by side, slowed where it matters."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from PIL import Image, ImageDraw

from coopsim.bench.films.recording import Recording
from coopsim.bench.safety.panel import (
    BRAKE,
    CRASH,
    HIDDEN,
    KNOWN,
    TOLD,
    TRACK,
    Panel,
    View,
    width_of,
    wrapped,
)
from coopsim.geometry.se3 import Floats
from coopsim.types.taxonomy import CLASS_NAMES
from coopsim.viz import palette
from coopsim.viz.from_above import font_of, on_halo

SIZE_PX = (1280, 720)

_LEAD_S, _AFTER_S = 4.0, 2.0
"""Time shown before the first thing that happens, and after the last."""

_HOLDS_S = {"start": 4.0, "told": 3.0, "crash": 3.0, "end": 5.0}
"""Time for which the picture stands, to be read: about three words a second."""

_CALM_S = 30.0
"""Length of a clip from which on pictures stand so long; in a shorter one they stand for less."""

_MARGIN, _HEAD, _PANEL_TOP, _PANEL, _STRIP = 16, 52, 92, (616, 458), (616, 64)
_STRIP_TOP, _CAPTION_TOP = _PANEL_TOP + _PANEL[1] + 6, SIZE_PX[1] - 84
_WORDS_PX = 22
_DIM: palette.RGB = (150, 156, 164)


class Beat(NamedTuple):
    """A part of a clip.

    Attributes:
        from_s: time of the episode at its start.
        to_s: time of the episode at its end.
        lasts_s: time that it takes in the clip.
        caption: lines below the panels.
    """

    from_s: float
    to_s: float
    lasts_s: float
    caption: tuple[str, ...]


@dataclass(frozen=True, slots=True, eq=False)
class PairClip:
    """The same seed twice.

    Attributes:
        alone: the run without messages.
        sharing: the run with messages.
        lasts_s: length of the clip.
        title: heading; empty: situation and seed.
    """

    alone: Recording
    sharing: Recording
    lasts_s: float = 30.0
    title: str = ""

    def beats(self) -> list[Beat]:
        """Return the parts of the clip: standing pictures to be read, and between them the runs, evenly slowed."""
        start_s, end_s = self._window()
        marks = sorted(self._marks(), key=lambda mark: mark[0])
        marks = [(max(at_s, start_s + 0.05), hold, told) for at_s, hold, told in marks if at_s < end_s]
        hurry = min(self.lasts_s / _CALM_S, 1.0)
        marks = [(at_s, hold * hurry, told) for at_s, hold, told in marks]
        stands = [_HOLDS_S["start"] * hurry, *(hold for _, hold, _ in marks), _HOLDS_S["end"] * hurry]
        slow = max(self.lasts_s - sum(stands), 1.0) / (end_s - start_s)
        caption = self._opening()
        beats = [Beat(start_s, start_s, stands[0], caption)]
        now = start_s
        for at_s, hold, told in marks:
            beats.append(Beat(now, at_s, (at_s - now) * slow, caption))
            caption, now = (told,), at_s
            if hold:
                beats.append(Beat(at_s, at_s, hold, caption))
        beats.append(Beat(now, end_s, (end_s - now) * slow, caption))
        return [*beats, Beat(end_s, end_s, stands[-1], self._ending())]

    def frames(self, frames_per_s: int = 20) -> Iterator[Image.Image]:
        """Draw all frames; a standing picture is one object, yielded again."""
        painter = _Painter(self, *self._window())
        for beat in self.beats():
            count = round(beat.lasts_s * frames_per_s)
            standing = painter.draw(beat.from_s, beat.caption) if beat.from_s == beat.to_s else None
            for k in range(count):
                if standing is not None:
                    yield standing
                else:
                    yield painter.draw(beat.from_s + (beat.to_s - beat.from_s) * k / count, beat.caption)

    def _window(self) -> tuple[float, float]:
        """Return the times of the episode at which the clip begins and ends."""
        both = (self.alone, self.sharing)
        happens = [at_s for run in both for at_s, _, _ in run.events.words()]
        nearest = [float(run.drive.time_s[run.events.closest]) for run in both]
        first, last = min([*happens, *nearest]), max([*happens, *nearest])
        start_s = max(first - _LEAD_S, float(self.alone.drive.time_s[0]))
        return start_s, min(last + _AFTER_S, max(run.end_s for run in both))

    def _marks(self) -> Iterator[tuple[float, float, str]]:
        """Yield time, length of the standing picture and caption of what happens."""
        alone, sharing = self.alone.events, self.sharing.events
        if sharing.told_by is not None and sharing.tracked_s is not None:
            sight = "in sight again" if sharing.again else "in sight"
            ahead = (
                "" if sharing.seen_s is None else f", {sharing.seen_s - sharing.tracked_s:.1f} s before it is {sight}"
            )
            told = f"with messages, the car hears of the {self._met()} from {sharing.told_by}{ahead}."
            yield sharing.tracked_s, _HOLDS_S["told"], f"{sharing.tracked_s:.1f} s: {told}"
        if alone.seen_s is not None:
            again = " again" if alone.again else ""
            tracked_s = alone.tracked_s
            then = (
                f"; the car has a track of it at {tracked_s:.1f} s" if tracked_s and tracked_s >= alone.seen_s else ""
            )
            yield (
                alone.seen_s,
                0.0,
                f"{alone.seen_s:.1f} s: alone, the {self._met()} is in sight{again} only now{then}.",
            )
        for run, name in ((self.alone, "alone"), (self.sharing, "with messages")):
            if run.events.crash_s is not None:
                yield run.events.crash_s, _HOLDS_S["crash"], f"{run.events.crash_s:.1f} s: {_crash(run, name)}"

    def _opening(self) -> tuple[str, ...]:
        return (
            "One world, played twice: the same seed gives the same traffic, people and noise.",
            f"In the ring: the {self._met()}. Left, the car knows what it sees; right, also what others send.",
        )

    def _ending(self) -> tuple[str, ...]:
        return f"Alone: {outcome(self.alone)}", f"With messages: {outcome(self.sharing)}"

    def _met(self) -> str:
        labels = self.alone.drive.label[self.alone.drive.in_conflict]
        name = CLASS_NAMES[int(labels[0])] if len(labels) else "object"
        return "other car" if name == "car" else name


def _crash(run: Recording, name: str) -> str:
    return f"{name}, the car crashes at {3.6 * run.events.impact_m_s:.0f} km/h."


def outcome(run: Recording) -> str:
    """Describe the end of a run, and the way there, in a sentence."""
    events = run.events
    past = {"told": f"heard of it from {events.told_by}", "track": "had a track of it", "brake": "braked hard"}
    happened = [f"{past[kind]} at {at_s:.1f} s" for at_s, kind, _ in events.words() if kind in past]
    missing = ["never had a track of it"] * (events.tracked_s is None)
    missing += ["did not brake hard"] * (events.braked_s is None)
    end = "no crash." if events.crash_s is None else f"crash at {3.6 * events.impact_m_s:.0f} km/h."
    return ", ".join([*happened, *missing, end])


def _knowledge(run: Recording, time_s: float) -> tuple[str, palette.RGB]:
    """Return what the car knows at a time of what it must not touch, in words, with their colour."""
    now, events = run.at(time_s), run.events
    if any(known for _, known in now.conflicts):
        by_message = events.told_by is not None and events.tracked_s is not None and time_s >= events.tracked_s
        by_message = by_message and (events.seen_s is None or time_s < events.seen_s)
        return (f"heard of it from {events.told_by}", TOLD) if by_message else ("has a track", KNOWN)
    return ("in sight, no track", HIDDEN) if now.in_view else ("hidden", HIDDEN)


_KEYS = (
    ("must not touch, no track", HIDDEN, "ring"),
    ("has a track", KNOWN, "ring"),
    ("track", TRACK, "box"),
    ("false track", palette.FALSE_TRACK, "cross"),
    ("message", TOLD, "line"),
    ("brake", BRAKE, "line"),
)
"""Words of the legend with colour and shape."""

_MOMENT_COLORS = {"sight": HIDDEN, "told": TOLD, "track": KNOWN, "brake": BRAKE, "crash": CRASH}


def _draw_key(draw: ImageDraw.ImageDraw, x: float, color: palette.RGB, shape: str) -> None:
    if shape == "ring":
        draw.ellipse((x, 22, x + 14, 36), outline=color, width=2)
    elif shape == "line":
        draw.line((x, 29, x + 15, 29), color, 3)
    else:
        draw.rectangle((x, 24, x + 15, 34), outline=color, width=2 if shape == "box" else 1)
    if shape == "cross":
        draw.line((x, 24, x + 15, 34), color, 1)
        draw.line((x, 34, x + 15, 24), color, 1)


class _Painter:
    """Draws whole frames: title, two panels, two strips of speed over time, and the caption."""

    def __init__(self, clip: PairClip, start_s: float, end_s: float) -> None:
        self._clip, self._start_s, self._end_s = clip, start_s, end_s
        self._runs = (clip.alone, clip.sharing)
        view = View.of(self._runs, start_s, _PANEL[0] / _PANEL[1])
        self._panels = [Panel(run, view, _PANEL) for run in self._runs]
        self._top_m_s = max(float(run.drive.speed_m_s.max()) for run in self._runs) + 1.0

    def draw(self, time_s: float, caption: Sequence[str]) -> Image.Image:
        picture = Image.new("RGB", SIZE_PX, (14, 16, 20))
        draw = ImageDraw.Draw(picture)
        self._heading(draw, time_s)
        for k, (run, panel) in enumerate(zip(self._runs, self._panels, strict=True)):
            left = _MARGIN + k * (SIZE_PX[0] - 2 * _MARGIN - _PANEL[0])
            picture.paste(panel.draw(time_s), (left, _PANEL_TOP))
            self._name(draw, k, left)
            self._state(draw, run, left, time_s)
            self._strip(draw, run, left, time_s)
        for k, line in enumerate(wrapped(caption, 22, SIZE_PX[0] - 2 * _MARGIN)[:2]):
            draw.text(
                (SIZE_PX[0] / 2 - width_of(line, 22) / 2, _CAPTION_TOP + 8 + 32 * k), line, (236, 239, 243), font_of(22)
            )
        return picture

    def _heading(self, draw: ImageDraw.ImageDraw, time_s: float) -> None:
        cell = self._clip.sharing.cell
        title = self._clip.title or f"{cell.condition.scenario.replace('_', ' ')}, seed {cell.seed}"
        on_halo(draw, (_MARGIN, 12), title, palette.TEXT, 28)
        x = SIZE_PX[0] - _MARGIN - 96 - sum(34 + width_of(text, 16) for text, _, _ in _KEYS)
        for text, color, shape in _KEYS:
            _draw_key(draw, x, color, shape)
            draw.text((x + 22, 19), text, _DIM, font_of(16))
            x += 34 + width_of(text, 16)
        clock = f"{time_s:4.1f} s"
        draw.text((SIZE_PX[0] - _MARGIN - width_of(clock, 28), 12), clock, palette.TEXT, font_of(28))

    def _name(self, draw: ImageDraw.ImageDraw, k: int, left: int) -> None:
        cell = self._runs[k].cell
        late = f", messages {1000 * cell.condition.latency_s:g} ms late" if k and cell.condition.latency_s else ""
        heading = ("Alone", "With messages")[k]
        draw.text((left, _HEAD + 8), heading, palette.AGENT, font_of(22))
        draw.text((left + width_of(heading, 22) + 12, _HEAD + 14), cell.policy + late, _DIM, font_of(16))

    def _state(self, draw: ImageDraw.ImageDraw, run: Recording, left: int, time_s: float) -> None:
        """Write over the panel how things stand."""
        events = run.events
        if events.crash_s is not None and time_s >= events.crash_s - 1e-9:
            text, color = f"CRASH  {3.6 * run.events.impact_m_s:.0f} km/h", CRASH
        elif events.braked_s is not None and time_s >= events.braked_s and run.at(time_s).acceleration_m_s2 < -1:
            text, color = "braking", BRAKE
        else:
            text, color = _knowledge(run, time_s)
        on_halo(draw, (left + _PANEL[0] - 14 - width_of(text, 24), _PANEL_TOP + 10), text, color, 24)

    def _strip(self, draw: ImageDraw.ImageDraw, run: Recording, left: int, time_s: float) -> None:
        """Draw the speed so far, and marks of what happened."""
        width, height = _STRIP
        top, bottom = _STRIP_TOP, _STRIP_TOP + height

        def across(at_s: float) -> float:
            return left + width * (at_s - self._start_s) / (self._end_s - self._start_s)

        draw.rectangle((left, top, left + width, bottom), (24, 27, 32))
        times, speeds = self._so_far(run, time_s)
        heights = bottom - (height - 22) * speeds / self._top_m_s
        line = list(zip(map(across, times.tolist()), heights.tolist(), strict=True))
        if len(line) > 1:
            draw.polygon([(line[0][0], bottom), *line, (line[-1][0], bottom)], (58, 54, 40))
            draw.line(line, palette.AGENT, 2)
        free = left - 1.0
        for at_s, kind, text in run.events.words():
            if not self._start_s <= at_s <= time_s + 1e-9:
                continue
            x, color = across(at_s), _MOMENT_COLORS[kind]
            text = kind if kind == "crash" else text  # its speed stands in the panel
            draw.line((x, top, x, bottom), color, 2)
            place = max(x + 5, free + 8)
            draw.text((place, top + 2), text, color, font_of(14))
            free = place + width_of(text, 14)
        on_halo(draw, (left + 6, bottom - 22), f"{3.6 * float(speeds[-1]):.0f} km/h", palette.TEXT, 15)

    def _so_far(self, run: Recording, time_s: float) -> tuple[Floats, Floats]:
        drive = run.drive
        until = min(time_s, run.end_s)
        shown = (drive.time_s >= self._start_s - 1e-9) & (drive.time_s < until)
        times = np.append(drive.time_s[shown], until)
        return times, np.interp(times, drive.time_s, drive.speed_m_s)
