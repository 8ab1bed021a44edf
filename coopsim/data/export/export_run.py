"""Exports: run, interrupted and gone on with at any moment, and checked."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import closing
from pathlib import Path
from typing import Any

from coopsim.data.export.export_card import (
    CARD,
    DONE,
    PICTURE,
    EpisodeCounts,
    ExportCard,
    check_card,
    frame_picture,
    open_card,
    read_card,
)
from coopsim.data.export.export_format import ExportFormat, make_export_format
from coopsim.data.export.export_frame import ExportFrame, ExportPlan, ExportSource
from coopsim.data.export.folder_checks import Problem
from coopsim.errors import ExportError, InvalidValueError
from coopsim.support.checks import as_runs
from coopsim.support.files import WrittenFiles, locked, make_folder, write_whole_bytes


def export(
    format: str,  # noqa: A002  (the user's word)
    environment: str | Path,
    folder: str | Path,
    *,
    seeds: Iterable[int] = (0,),
    frames: int = 100,
    progress: Callable[[int], object] | None = None,
    **options: Any,
) -> Path:
    """Simulate episodes and write them as a folder in the format of a data set.

    An export that was interrupted goes on with the same call: finished episodes stay, the one that was interrupted is
    simulated again, and the folder ends in the same bytes. A finished one is left as it is.

    Args:
        format: name of the format, or its spec, as "opv2v" or "opv2v(lidar=roof)".
        environment: name of a simulated environment, or path of a scenario file.
        folder: is made; it must be new, empty, or hold this export.
        seeds: seeds of the episodes.
        frames: number of frames of each episode.
        progress: called with the number of frames that are done, at first with those of an earlier call.
        **options: options of the environment; plain data.

    Raises:
        CoopsimError: the format, the environment or an option is not known or not accepted; the folder holds something
            else, cannot be written, or is in use by another process.
    """
    if not isinstance(folder, (str, os.PathLike)):
        raise InvalidValueError(f"folder must be a path, got {folder!r}")
    plan = ExportPlan(format, str(environment), as_runs(seeds=seeds), frames, options)
    writer, report = make_export_format(format), progress or (lambda count: None)
    with closing(ExportSource(plan, writer.usual_options)) as source:
        writer.require(source.agents)
        make_folder(Path(folder))
        with locked(Path(folder)):
            card = open_card(Path(folder), plan)
            report(plan.frames * len(card.episodes))
            if not card.done:
                _write(plan, writer, source, card, report)
    return Path(folder)


def _write(
    plan: ExportPlan, writer: ExportFormat, source: ExportSource, card: ExportCard, report: Callable[[int], object]
) -> None:
    with WrittenFiles(card.folder) as written:
        writer.begin(card.folder, plan)
        for number, seed in enumerate(plan.seeds):
            if seed in card.episodes:
                continue
            counts = EpisodeCounts(list(source.agents))
            writer.begin_episode(seed)
            for frame in source.episode(seed):
                writer.write(frame)
                if number == 0 and frame.index == plan.frames // 2:
                    write_whole_bytes(card.folder / PICTURE, frame_picture(frame, source.road_map))
                _count(frame, counts)
                report(1)
            writer.end_episode()
            written.sync()  # before the card says that they are there
            card.episodes[seed] = counts
            card.write()
        writer.end()
        card.finish(written)


def _count(frame: ExportFrame, counts: EpisodeCounts) -> None:
    for agent in frame.agents:
        counts.points += sum(len(scan.points) for scan in agent.lidars.values())
        counts.pictures += len(agent.cameras)
    counts.objects += int((frame.returns > 0).any(axis=1).sum())


def check_export(folder: str | Path, format: str | None = None) -> Iterator[Problem]:  # noqa: A002
    """Yield what is wrong in an exported folder; nothing if all is well.

    Args:
        folder: the export.
        format: spec of a format, as `export` takes it; None: as the folder's `export.json` says. Where it is
            given, the folder need not be an export of coopsim: only the format is checked.

    Raises:
        ExportError: there is no such folder, or it does not say its format.
        CoopsimError: the format is not known.
    """
    folder = Path(folder)
    if not folder.is_dir():
        raise ExportError(f"there is no folder {folder}")
    if format is None and not (folder / CARD).is_file():
        raise ExportError(f"{folder} has no {CARD}: `coopsim export` did not write it. Say of which format it is")
    card = None if format is not None else read_card(folder)
    writer = make_export_format(str(card["format"]) if card is not None else str(format))
    return _problems(folder, writer, card)


def _problems(folder: Path, writer: ExportFormat, card: Mapping[str, Any] | None) -> Iterator[Problem]:
    if card is not None:
        yield from check_card(folder)
    if card is None or card["state"] == DONE:  # of an interrupted export, more is missing than would be told
        yield from writer.check(folder)
