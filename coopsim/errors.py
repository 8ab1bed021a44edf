"""Errors that coopsim raises on purpose.

All derive from `CoopsimError`, so that one `except` catches them. Each also derives from the builtin
class that a caller would expect (`ValueError`, `KeyError`, `RuntimeError`, `ImportError`).
"""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Mapping
from typing import Any, Self

_LONGEST, _SHOWN_END = 4000, 500
"""Most letters of a line of a message, and of its end where it is longer."""

_CLOSE, _NEARLY = 0.6, 0.1
"""Least likeness of a name that is suggested, in [0, 1], and how much less than the closest it may have."""

_BEGINNING = 3
"""Least letters of a beginning that stands for a name."""

_FEW = 12
"""Most names that are listed next to a suggestion: of options there are forty."""


def close_names(name: object, known: Iterable[str]) -> list[str]:
    """Return the names that were probably meant, the closest first: at most three, all about as close as the first.

    Where none is close, those are that begin with `name`, as one that was cut short.
    """
    text, accepted = str(name), list(known)
    close = difflib.get_close_matches(text, accepted, n=3, cutoff=_CLOSE)
    share = [difflib.SequenceMatcher(None, each, text).ratio() for each in close]
    begun = [each for each in accepted if len(text) >= _BEGINNING and each.startswith(text)]
    return [each for each, ratio in zip(close, share, strict=True) if ratio >= share[0] - _NEARLY] or begun[:3]


class CoopsimError(Exception):
    """Root of all coopsim errors."""

    place: str | None = None
    """"file:line" of the error, if known; the message then begins with it."""

    def __init__(self, *args: Any) -> None:
        super().__init__(*(_shortened(each) if isinstance(each, str) else each for each in args))

    def at(self, place: str | None) -> Self:
        """Set the place of an error that has none yet, and return the error."""
        if self.place is None and place is not None:
            self.place = place
            self.args = (f"{place}: {self}",)
        return self


class InvalidValueError(CoopsimError, ValueError):
    """A value is out of range, not finite, or of the wrong shape or type."""


class UnknownNameError(CoopsimError, LookupError):
    """A name is not among the known ones; the message has the close ones, and all where none is close or few are known.

    Args:
        kind: the kind of thing that the name stands for, as "policy".
        name: the unknown name.
        known: all accepted names.
        where: the whole that the name is a part of, "of policy 'late_fusion'"; it follows the name.
    """

    def __init__(self, kind: str, name: object, known: Iterable[str], where: str = "") -> None:
        self.kind, self.name, self.known, self.where = kind, name, tuple(sorted(known)), where
        close = close_names(name, self.known)
        hints = [f"Did you mean {' or '.join(map(repr, close))}?"] if close else []
        if not close or len(self.known) <= _FEW:
            hints.append(f"Accepted: {', '.join(self.known)}" if self.known else "There are none")
        super().__init__(f"unknown {kind} {name!r}{where and ' ' + where}. {' '.join(hints)}")

    def __reduce__(self) -> tuple[Any, ...]:  # errors of worker processes are pickled
        return type(self).__new__, (type(self), *self.args), self.__dict__


class WeightsNotShippedError(InvalidValueError):
    """Weights of this name do not ship yet; the message says how to train them."""


class DuplicateNameError(CoopsimError, ValueError):
    """A name is registered twice."""


class InvalidActionError(CoopsimError, ValueError):
    """An action is malformed, or is for an agent that is not in the environment."""


class IsolatedPolicyError(CoopsimError, RuntimeError):
    """A policy in a process of its own raised an error, took too long, answered nonsense, or its process died."""


class PlannerError(CoopsimError, RuntimeError):
    """A planner raised an error, took too long, or returned something other than a finite acceleration."""


class DefenseError(CoopsimError, RuntimeError):
    """A defence raised an error, or answered something other than trust in [0, 1]."""


class EpisodeStateError(CoopsimError, RuntimeError):
    """A call at the wrong moment, as `step` before `reset` or after the end."""


class PolicyMismatchError(CoopsimError, ValueError):
    """A policy needs another environment than the one it was given (for example another uplink)."""


class CodecError(CoopsimError, ValueError):
    """A content cannot be encoded by a codec, or bytes cannot be decoded as the message they claim to be."""


class RecordingError(CoopsimError, ValueError):
    """A recorded file is missing or broken; the message names the file and, where known, the line."""


class ScenarioFileError(CoopsimError, ValueError):
    """A scenario file is missing or broken; the message names the file and, where known, the line."""


class MapFileError(CoopsimError, ValueError):
    """A map of another program is missing, broken, or of a format that is not read; names file, line and element."""


class LogFileError(CoopsimError, ValueError):
    """A log of traffic is missing, broken, or holds what cannot be played."""


class GridFileError(CoopsimError, ValueError):
    """A benchmark's grid file is missing or broken; the message names the file and, where known, the line."""


class LeaderboardEntryError(CoopsimError, ValueError):
    """A folder that enters the leaderboard is broken, or its policy may not enter; names file and line, if known."""


class StoreError(CoopsimError, ValueError):
    """A file in a benchmark's store is broken; the message names it."""


class ExportError(CoopsimError, ValueError):
    """An exported folder is missing or broken, or holds something else than what is to be written there."""


class TrainingError(CoopsimError, RuntimeError):
    """A training cannot go on, as when its loss is no number; the message says at which step, and what is kept."""


class LostEnvironmentsError(CoopsimError, RuntimeError):
    """Environments of a vector are lost: they raised an error, or their worker died. The others go on.

    Attributes:
        reports: traceback or end of the worker, by index of a lost environment.
        results: result of the call, in which a lost environment's episode is truncated; None where there is none.
    """

    def __init__(self, reports: Mapping[int, str], results: Any = None) -> None:
        self.reports, self.results = dict(reports), results
        alike: dict[str, list[int]] = {}
        for index, report in self.reports.items():
            alike.setdefault(report, []).append(index)
        texts = [f"environment{'s'[: len(lost) > 1]} {', '.join(map(str, lost))}: {why}" for why, lost in alike.items()]
        super().__init__("lost " + "\nlost ".join(text.rstrip() for text in texts))

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), (self.reports, self.results)


class PlugInError(CoopsimError, ImportError):
    """A part of an installed package cannot be loaded; the message names the package."""


class MissingDependencyError(CoopsimError, ImportError):
    """An optional package is needed for this call; the message names what to install."""


class CrowdedWarning(UserWarning):
    """There is no space for all requested actors; the message says how many there are instead."""


class MapWarning(UserWarning):
    """Something in a map was wrong, and was repaired; the message says what was made of it."""


class RewardWarning(UserWarning):
    """The default reward is not of what the agent decides; the message says which one is."""


def _shortened(message: str) -> str:
    """Return a message whose lines lack their middle if they are too long, as where they show a stranger's value."""
    return message if len(message) <= _LONGEST else "\n".join(map(_shortened_line, message.split("\n")))


def _shortened_line(line: str) -> str:
    left = len(line) - _LONGEST
    start, end = line[: _LONGEST - _SHOWN_END], line[-_SHOWN_END:]
    return line if left <= 0 else f"{start} ... ({left} letters left out) ... {end}"
