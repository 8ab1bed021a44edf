"""Axes: any option of environments and policies varies, with a label, and a typo is told before the first cell."""

from __future__ import annotations

import argparse
import math
import pickle
from pathlib import Path
from typing import Any

import pytest
from helpers.synthetic_results import result

from coopsim.bench.benchmark import check
from coopsim.bench.engine.job import Job
from coopsim.bench.grid.axis import AXES, DEFAULT, axis_of
from coopsim.bench.grid.cell import Cell, Condition, environment_options
from coopsim.bench.grid.grid import Grid
from coopsim.bench.grid.grid_file import find_grid
from coopsim.bench.grid.labels import label, mildest, short_label, varying_axes
from coopsim.bench.paper.protocol_text import protocol_text
from coopsim.bench.paper.provenance import Provenance
from coopsim.bench.results.result_table import ResultTable
from coopsim.bench.text.bench_text import to_csv
from coopsim.catalog import PolicySpec
from coopsim.cli.argument_types import varied, varied_option
from coopsim.errors import CoopsimError, GridFileError, InvalidValueError, UnknownNameError

SMALL: dict[str, Any] = {"lidar": None, "vehicles": 4}
VARIED = {"budget_bytes": (100, 400), "weather": ("clear", "rain")}


def options(axes: dict[str, Any], given: dict[str, Any] | None = None, **more: Any) -> list[dict[str, Any]]:
    grid = Grid(("late_fusion",), axes=axes, options=given or {}, **more)
    return [environment_options(cell, grid.options) for cell in grid.cells()]


def test_any_option_varies_in_full_and_one_by_one() -> None:
    whole = [(each["budget_bytes"], each["weather"]) for each in options(VARIED)]
    assert whole == [(100, "clear"), (100, "rain"), (400, "clear"), (400, "rain")]
    single = [(each["budget_bytes"], each["weather"]) for each in options(VARIED, vary="one_by_one")]
    assert single == [(100, "clear"), (400, "clear"), (400, "rain")]  # more bytes are milder
    both = Grid(("late_fusion",), latencies_ms=(0, 300), axes=VARIED, vary="one_by_one")
    assert len(both) == 4 and len(list(both.conditions())) == 4


def test_short_forms_are_axes_with_units_of_their_own() -> None:
    short = {
        "latencies_ms": (0, 100),
        "losses": (0, 0.5),
        "position_noises_m": (0, 1),
        "heading_noises_deg": (0, 2),
        "bandwidths_mbit_s": (0.1, math.inf),
        "penetrations": (0.5, 1),
        "attacks": ("none", "cav_1=ghost"),
    }
    axes = {axis.option: tuple(map(axis.from_short, short[axis.short])) for axis in AXES}
    one, other = Grid(("no_fusion",), **short), Grid(("no_fusion",), axes=axes)  # type: ignore[arg-type]
    assert one.cells() == other.cells() and len(one) == 2**7
    with pytest.raises(InvalidValueError, match="latency_s must be given once, got it among axes, and latencies_ms"):
        Grid(("no_fusion",), latencies_ms=(0, 100), axes={"latency_s": (0, 0.2)})


def test_an_inner_option_leaves_the_others_of_its_mapping(tmp_path: Path) -> None:
    (made,) = options({"weather.rain_mm_h": (5,)}, {"weather": {"wetness": 0.5}})
    assert made["weather"] == {"wetness": 0.5, "rain_mm_h": 5}
    waits = options({"channel.bandwidth.max_wait_s": (0.1, 0.5)}, bandwidths_mbit_s=(1,))
    assert [each["channel"]["bandwidth"] for each in waits] == [
        {"max_wait_s": wait_s, "rate_bit_s": 1e6} for wait_s in (0.1, 0.5)
    ]
    scenario = tmp_path / "mine.yaml"
    scenario.write_text("scenario: crossing\noptions: {weather: {wetness: 0.25}, lidar: null}\n")
    (made,) = options({"weather.rain_mm_h": (5,)}, scenarios=(str(scenario),))
    assert made["weather"] == {"wetness": 0.25, "rain_mm_h": 5}


def test_null_is_a_value_and_what_is_not_said_is_left_alone() -> None:
    none, beams = options({"lidar": (None, "VLP-16")})
    assert none["lidar"] is None and beams["lidar"] == "VLP-16"
    assert "lidar" not in environment_options(Cell("late_fusion", Condition()), {})
    conditions = [Condition(lidar=None), Condition(lidar="VLP-16"), Condition()]
    assert [label(each, conditions) for each in conditions] == ["lidar none", "lidar VLP-16", f"lidar {DEFAULT}"]
    own = environment_options(Cell("late_fusion", Condition(latency_s=None, loss=None, position_noise_m=None)), {})
    assert not {"latency_s", "loss", "position_noise_m"} & own.keys()


def test_a_parameter_of_policies_varies_for_those_that_have_it() -> None:
    grid = Grid(("late_fusion", "coop_fuse"), axes={"policy.merge": ("mean", "best")}, options=SMALL)
    jobs = [Job.of(cell, grid.options, PolicySpec.parse(cell.policy)) for cell in grid.cells()]
    told = [(job.cell.policy, job.policy.text) for job in jobs]
    assert told == [
        ("late_fusion", "late_fusion(merge=mean)"),
        ("coop_fuse", "coop_fuse"),
        ("late_fusion", "late_fusion(merge=best)"),
        ("coop_fuse", "coop_fuse"),
    ]
    assert not [name for job in jobs for name in environment_options(job.cell, {}) if name.startswith("policy")]
    with pytest.raises(InvalidValueError, match=r"policy\.merge must be given once"):
        check(Grid(("late_fusion(merge=mean)",), axes={"policy.merge": ("mean", "best")}, options=SMALL))


@pytest.mark.parametrize(
    ("axes", "error", "message"),
    [
        ({"budget_byte": (100,)}, UnknownNameError, "unknown option 'budget_byte'. Did you mean 'budget_bytes'"),
        ({"budget_bytes": (100, -1)}, InvalidValueError, "budget_bytes must be"),
        ({"weather": ("clear", "rian")}, UnknownNameError, "unknown weather 'rian'. Did you mean 'rain'"),
        ({"weather.rain_mm": (1,)}, UnknownNameError, "unknown weather option 'rain_mm'. Did you mean 'rain_mm_h'"),
        (
            {"policy.mergee": ("mean",)},
            UnknownNameError,
            "unknown parameter of policies 'mergee'",
        ),
        ({"policy.merge": ("mean", "bets")}, CoopsimError, "merge"),
        ({"max_cycles": (5,)}, InvalidValueError, "max_cycles is not an option here: use frames"),
        ({"vehicles": (4, 4)}, InvalidValueError, "vehicles must be distinct, got 4 twice"),
        ({"vehicles": 4}, InvalidValueError, "vehicles must be a list of at least one"),
        ({"loss": (0, 2)}, InvalidValueError, r"loss must be in \[0, 1\], got 2"),
        ({"attacks": (3,)}, InvalidValueError, "attacks must be texts"),
        ({"rsus": (object(),)}, InvalidValueError, "rsus must be plain data"),
    ],
)
def test_a_typo_is_one_line_before_the_first_cell(axes: dict[str, Any], error: type, message: str) -> None:
    with pytest.raises(error, match=message) as raised:
        check(Grid(("late_fusion",), axes=axes, options={"lidar": None}))
    assert "\n" not in str(raised.value)


def test_an_option_and_an_axis_of_one_name_are_one_too_many() -> None:
    with pytest.raises(InvalidValueError, match="vehicles must be given once, got it among options and axes"):
        Grid(("late_fusion",), axes={"vehicles": (4, 8)}, options={"vehicles": 4})


def test_a_file_has_axes_and_is_told_where_they_are_wrong(tmp_path: Path) -> None:
    path = tmp_path / "grid.yaml"
    path.write_text("policies: [late_fusion]\naxes:\n  budget_bytes: [100, 400]\n  weather: [clear, rain]\n")
    grid = find_grid(path=path, axes={"budget_bytes": (50,), "rsus": (0, 1)}).grid()
    assert grid.axes == {"budget_bytes": (50,), "weather": ("clear", "rain"), "rsus": (0, 1)}
    path.write_text("policies: [late_fusion]\naxes:\n  weather: [clear]\n  budget_byte: [100]\n")
    source = find_grid(path=path)
    with pytest.raises(UnknownNameError) as raised:
        check(source.grid())
    assert str(source.blame(raised.value)).startswith(f"{path}:4: unknown option 'budget_byte'")
    path.write_text("policies: [late_fusion]\naxes:\n  attacks: ['cav_1=mine.py:A']\n")
    with pytest.raises(GridFileError, match="axes name code to run"):
        find_grid(path=path)


def test_the_command_takes_values_as_yaml_has_them() -> None:
    assert varied_option("one_by_one") == "one_by_one"
    assert varied_option("budget_bytes=100,400") == ("budget_bytes", (100, 400))
    assert varied_option("lidar=null, VLP-16") == ("lidar", (None, "VLP-16"))
    assert varied_option("weather={rain_mm_h: 1, wetness: 0},clear") == (
        "weather",
        ({"rain_mm_h": 1, "wetness": 0}, "clear"),
    )
    assert varied_option("attacks=cav_1=ghost(ahead_m=15, label=car),none")[1][1] == "none"
    for text in ("onebyone", "=3", "latency_s"):
        with pytest.raises(argparse.ArgumentTypeError, match="must be product, one_by_one or an option as name="):
            varied_option(text)
    given = varied(["one_by_one", ("rsus", (0, 1))])
    assert given == {"vary": "one_by_one", "axes": {"rsus": (0, 1)}} and varied([]) == {"vary": None, "axes": None}
    for twice in (["product", "one_by_one"], [("rsus", (0,)), ("rsus", (1,))]):
        with pytest.raises(InvalidValueError, match="--vary must be given once"):
            varied(twice)


def test_conditions_are_values_and_keep_the_columns_of_results() -> None:
    condition = Condition("crossing", {"weather.rain_mm_h": 5}, latency_s=0.3, heading_noise_deg=0.2, budget_bytes=100)
    assert condition == Condition("crossing", dict(condition.settings)) == pickle.loads(pickle.dumps(condition))
    assert condition.columns() == {
        "scenario": "crossing",
        "latency_s": 0.3,
        "loss": 0.0,
        "position_noise_m": 0.0,
        "heading_noise_deg": 0.2,
        "bandwidth_bit_s": math.inf,
        "penetration": None,
        "attacks": "",
        "budget_bytes": 100,
        "weather.rain_mm_h": 5,
    }
    assert condition.get("heading_noise_rad") == math.radians(0.2) and condition.heading_noise_deg == 0.2
    assert condition.changed(attacks="none", latency_s=0).settings == tuple(
        (option, value) for option, value in condition.settings if option != "latency_s"
    )
    assert (condition.budget_bytes, Condition().latency_s, hash(condition)) == (100, 0.0, hash(condition.changed()))
    with pytest.raises(AttributeError, match="'vehicles' unless it says so"):
        condition.vehicles  # noqa: B018
    with pytest.raises(InvalidValueError, match=r"loss must be in \[0, 1\]"):
        Condition(loss=2)
    given = [Condition(vehicles=each) for each in ("many", 12, 3, None)]
    assert sorted(given) == given[::-1]


def test_axes_have_readable_names_units_and_a_mildest_value() -> None:
    shown = {option: axis_of(option).heading for option in ("budget_bytes", "channel.bandwidth.max_wait_s", "codec")}
    assert list(shown.values()) == ["budget (bytes)", "channel bandwidth max wait (s)", "codec"]
    grid = Grid(("no_fusion",), axes={"budget_bytes": (100, 400), "codec": ("detections", "compact"), "rsus": (0, 2)})
    conditions = list(grid.conditions())
    assert [axis.title for axis in varying_axes(conditions)] == ["budget", "codec", "rsus"]
    assert label(conditions[0], conditions) == "budget 100 bytes, codec detections, rsus 0"
    assert short_label(conditions[0], conditions) == "100 bytes, codec detections, rsus 0"
    assert [each.settings for each in mildest(conditions)] == [
        (("budget_bytes", 400), ("codec", "compact"), ("rsus", 0))
    ]


def test_tables_and_protocol_have_the_axes() -> None:
    grid = Grid(("good", "bad"), axes=VARIED)
    table = ResultTable.of([result(cell, 50.0) for cell in grid.cells()])
    first, *rows = to_csv(table).splitlines()
    assert ",attacks,budget_bytes,weather,seed," in first and len(rows) == 8 and ",,100,clear,0," in rows[0]
    text = protocol_text(table, Provenance(grid={"vary": "product"}), ["sAMOTA"])
    assert "budget (bytes): 400, 100\nweather: clear, rain\n4 conditions: every value with every other" in text
