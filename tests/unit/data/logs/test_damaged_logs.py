"""Broken and hostile logs: one line each, which names the row, its id or the part."""

from __future__ import annotations

import os
import pickle
from collections.abc import Callable
from pathlib import Path
from typing import Any

import log_files
import numpy as np
import pytest

from coopsim.data.logs.reading import read_log
from coopsim.errors import CoopsimError

T, F, INT = log_files.TABLE, log_files.FLOATING, log_files.INTERACTION

TABLES: list[tuple[str, str, str]] = [
    ("empty", "", "no table"),
    ("header only", T.splitlines()[0], "no table"),
    ("no x", T.replace("x_m", "x"), "of no format"),
    ("word for a time", T.replace("0.1,a", "soon,a"), "line 3, column time_s must be a number, got 'soon'"),
    ("endless time", T.replace("0.1,a", "inf,a"), "line 3 (id a): time must be finite"),
    ("no place", T.replace("0.1,a,car,1.0", "0.1,a,car,nan"), "line 3 (id a): position"),
    ("empty place", T.replace("0.1,a,car,1.0", "0.1,a,car,"), "line 3 (id a): position"),
    ("far away", T.replace("0.1,a,car,1.0", "0.1,a,car,1e300"), "line 3 (id a): position"),
    ("leap", T.replace("0.1,a,car,1.0", "0.1,a,car,1000"), "line 3 (id a): it leaps 1000 m"),
    ("twice", T.replace("0.1,a", "0.2,a"), "(id a): there is another row of this id at 0.2 s"),
    ("unknown class", T.replace("walker,pedestrian", "walker,ghost"), "line 6, column class must be a type"),
    ("negative length", T.replace("0.0,4.2", "0.0,-4.2"), "line 2 (id a): length, width and height"),
    ("long", T.replace("0.0,4.2", "0.0,4200"), "line 2 (id a): length, width and height"),
    ("no length", T.replace("0.0,4.2", "0.0,0"), "line 2 (id a): length, width and height"),
    ("heading", T.replace("0.1,a,car,1.0,0.0,0.0", "0.1,a,car,1.0,0.0,inf"), "line 3 (id a): heading"),
    ("no id", T.replace("0.1,a,car", "0.1,,car"), "line 3, column id must not be empty"),
    ("cut off row", T[:-20], "no table, or is cut off"),
    ("no road user", T.replace("car", "trafficcone").replace("pedestrian", "barrier"), "no road user"),
    ("binary", "\x00\x01\x02" * 50, ""),
    ("case", INT.replace("timestamp_ms", "timestamp"), "of no format"),
    ("time of a case", INT.replace("1,1,1,100", "1,1,1,now"), "line 2, column timestamp_ms must be a number"),
    ("type of a case", INT.replace("car", "tank"), "line 2, column agent_type"),
]

XML: list[tuple[str, str, str]] = [
    ("empty", "", "no XML"),
    ("other root", "<net></net>", "its root must be <fcd-export>, got <net>"),
    ("cut off", F[:300], "cut off"),
    ("no x", F.replace('x="10.00" ', ""), "<vehicle id='x' at 10 s>: lacks x"),
    ("word", F.replace('y="50.00"', 'y="far"'), "<vehicle id='b' at 10 s>: could not convert"),
    ("no time", F.replace('time="10.10"', ""), "<timestep>: lacks time"),
    ("nan", F.replace('speed="1.00"', 'speed="nan"'), "(id p)"),
    ("entity", '<!DOCTYPE a [<!ENTITY b "c">]>' + F, "entity"),
    ("no id", F.replace('id="p" ', ""), "lacks id"),
    ("twice", F.replace('time="10.10"', 'time="10.00"'), "another row of this id"),
]


def _with(**changes: Any) -> dict[str, Any]:
    content = log_files.scenario()
    content["tracks"]["17"]["state"] |= changes
    return content


class _Hostile:
    def __reduce__(self) -> Any:
        return os.system, ("touch hostile",)


class _Stealthy:
    """An array that is made by something else."""

    def __reduce__(self) -> Any:
        return np.load, ("hostile.npy",)


PICKLES: list[tuple[str, Callable[[], bytes], str]] = [
    ("hostile", lambda: pickle.dumps({"tracks": _Hostile()}), "refused"),
    ("stealthy", lambda: pickle.dumps({"tracks": _Stealthy()}), "refused"),
    ("objects", lambda: pickle.dumps(_with(heading=np.array([{}] * 4, object))), "plain numbers"),
    ("empty", lambda: b"", "broken"),
    ("cut off", lambda: pickle.dumps(log_files.scenario())[:-200], "broken"),
    ("a list", lambda: pickle.dumps([1, 2]), "no tracks"),
    ("no times", lambda: pickle.dumps(log_files.scenario() | {"metadata": {}}), "ts must be numbers"),
    ("short", lambda: pickle.dumps(_with(heading=np.zeros(3))), "track 17, heading must be numbers of shape 4 x 1"),
    ("texts", lambda: pickle.dumps(_with(heading=["a"] * 4)), "track 17, heading"),
    ("lacks", lambda: pickle.dumps(_with(velocity=None)), "track 17, velocity must be numbers"),
    ("nan", lambda: pickle.dumps(_with(position=np.full((4, 3), np.nan))), "position must be finite"),
    ("type", lambda: pickle.dumps({**_typed("SPACESHIP")}), "track 17 must be a type"),
]


def _typed(name: str) -> dict[str, Any]:
    content = log_files.scenario()
    content["tracks"]["17"]["type"] = name
    return content


def _refused(path: Path, said: str) -> None:
    with pytest.raises(CoopsimError) as found:
        read_log(path)
    text = str(found.value)
    assert said in text
    assert "\n" not in text


@pytest.mark.parametrize(("name", "text", "said"), TABLES, ids=[row[0] for row in TABLES])
def test_damaged_table(tmp_path: Path, name: str, text: str, said: str) -> None:
    (tmp_path / "a.csv").write_text(text)
    _refused(tmp_path / "a.csv", said)


@pytest.mark.parametrize(("name", "text", "said"), XML, ids=[row[0] for row in XML])
def test_damaged_floating_cars(tmp_path: Path, name: str, text: str, said: str) -> None:
    (tmp_path / "a.fcd.xml").write_text(text)
    _refused(tmp_path / "a.fcd.xml", said)


@pytest.mark.parametrize(("name", "data", "said"), PICKLES, ids=[row[0] for row in PICKLES])
def test_damaged_pickle_runs_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str, data: Callable[[], bytes], said: str
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "a.pkl").write_bytes(data())
    _refused(tmp_path / "a.pkl", said)
    assert not (tmp_path / "hostile").exists()


@pytest.mark.parametrize("part", ["tracksMeta", "recordingMeta"])
def test_missing_part_of_a_recording(tmp_path: Path, part: str) -> None:
    path = log_files.write_level_x(tmp_path, log_files.IND)
    (tmp_path / f"07_{part}.csv").unlink()
    _refused(path, f"no file {tmp_path / f'07_{part}.csv'}")


def test_track_without_its_class(tmp_path: Path) -> None:
    parts = log_files.IND | {"tracksMeta": "recordingId,trackId,class\n7,0,car\n"}
    _refused(log_files.write_level_x(tmp_path, parts), "has no row of trackId 1")


@pytest.mark.parametrize("name", ["gone.csv", "a.bag"])
def test_missing_and_unknown_files(tmp_path: Path, name: str) -> None:
    (tmp_path / "a.bag").write_text("")
    _refused(tmp_path / name, name)
