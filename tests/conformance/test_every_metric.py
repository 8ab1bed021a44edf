"""Every registered metric keeps what scores, tables and reports rely on; the check finds those that do not."""

from __future__ import annotations

from typing import Any

import pytest

from coopsim.episode import RECORDERS, Episode, Recorder
from coopsim.errors import UnknownNameError
from coopsim.metrics import METRICS, LogPool, Metric
from coopsim.testing import check_metric


@pytest.mark.parametrize("name", METRICS.names())
def test_metric(name: str) -> None:
    check_metric(name)


class Good(Metric):
    meaning = "reported boxes"
    less_is_better = True

    def value(self, pool: LogPool) -> float | None:
        return pool.reported


def test_a_class_or_an_object_is_taken() -> None:
    check_metric(Good)
    check_metric(Good())
    with pytest.raises(UnknownNameError, match=r"unknown metric 'HOAT'. Did you mean 'HOTA'"):
        check_metric("HOAT")


class Undescribed(Good):
    meaning = ""


class Shouts(Good):
    def value(self, pool: LogPool) -> Any:
        return "many"


class Counts(Good):
    count = 0

    def value(self, pool: LogPool) -> float | None:
        Counts.count += 1
        return Counts.count


class ReadsIds(Good):
    def value(self, pool: LogPool) -> float | None:
        return float(sum(log.track_id.sum() for log in pool.logs))


class ReadsDriveIds(Good):
    def value(self, pool: LogPool) -> float | None:
        return float(sum(log.drive.ids.sum() for log in pool.records["drives"]))


class Divides(Good):
    def value(self, pool: LogPool) -> float | None:
        return 1 / pool.objects


class Changes(Good):
    def value(self, pool: LogPool) -> float | None:
        for log in pool.logs:
            log.score[:] = 0.0
        return 0.0


class WrongWay(Good):
    def value(self, pool: LogPool) -> float | None:
        return pool.sweep.all_tracks.mota


class Heard(Recorder):
    def begin(self, episode: Episode) -> None:
        self.heard = {agent: len(seen.inbox) for agent, seen in episode.received.items()}

    def records(self) -> dict[str, int]:
        return self.heard


class Hears(Good):
    recorders = ("heard",)

    def value(self, pool: LogPool) -> Any:
        return pool.records["heard"][0] if pool.records["heard"] else None


class HearsWords(Hears):
    def value(self, pool: LogPool) -> Any:
        return "all" if pool.records["heard"] else None


def test_a_metric_is_checked_with_the_recorders_that_it_names(monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(UnknownNameError, match="unknown recorder 'heard'"):
        check_metric(Hears)
    monkeypatch.setitem(RECORDERS._entries, "heard", Heard)
    check_metric(Hears)
    with pytest.raises(AssertionError, match="must be a number or None, got 'all'"):
        check_metric(HearsWords)


@pytest.mark.parametrize(
    ("metric", "message"),
    [
        (Undescribed, "`meaning` must be one line"),
        (Shouts, "must be a number or None, got 'many'"),
        (Counts, "must give the same value for the same log"),
        (ReadsIds, "must not depend on the numbers of ids"),
        (ReadsDriveIds, "must not depend on the numbers of ids"),
        (Divides, "division by zero"),
        (Changes, "must leave the logs as they are, and changed score"),
        (WrongWay, "less is better"),
    ],
)
def test_what_breaks_a_table_is_found(metric: type[Metric], message: str) -> None:
    with pytest.raises((AssertionError, ZeroDivisionError), match=message):
        check_metric(metric)
