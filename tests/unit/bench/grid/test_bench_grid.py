"""Grids: their cells, and what is told of one that is not accepted, with the line where there is a file."""

from __future__ import annotations

import math
import re
import shlex
from pathlib import Path
from typing import Any

import pytest

import coopsim
from coopsim.agents.perceiving_policy import PerceivingPolicy
from coopsim.bench.benchmark import check
from coopsim.bench.grid.cell import Cell, Condition, environment_options
from coopsim.bench.grid.grid import Grid
from coopsim.bench.grid.grid_file import PRESETS, find_grid
from coopsim.catalog import PolicySpec
from coopsim.cli.arguments import Parser
from coopsim.cli.bench_commands import BENCH, flag_values
from coopsim.comms.channel.channel_config import channel_config
from coopsim.errors import CoopsimError, GridFileError, InvalidValueError, UnknownNameError, WeightsNotShippedError
from coopsim.learn.clips.world_recipe import WorldRecipe
from coopsim.support.checks import require_count
from coopsim.types import Observation, Tracks
from coopsim.world.drawn_options import PlaceSeeds

TWO = ("no_fusion", "late_fusion")


def test_cells_are_the_product() -> None:
    grid = Grid(TWO, latencies_ms=(0, 300), losses=(0, 0.5), bandwidths_mbit_s=(0.1, math.inf), seeds=(3, 5), frames=7)
    cells = grid.cells()
    assert len(cells) == len(grid) == len(set(cells)) == 2 * 2 * 2 * 2 * 2
    assert cells[0] == Cell("no_fusion", Condition("crossing", bandwidth_bit_s=1e5), 3, 7)
    assert {cell.condition.latency_s for cell in cells} == {0.0, 0.3}


def test_position_and_heading_go_together_or_not() -> None:
    noises: dict[str, Any] = {"position_noises_m": (0, 0.2, 0.4), "heading_noises_deg": (0, 0.2, 0.2)}
    together = Grid(TWO, **noises, pose="together")
    assert [(each.position_noise_m, each.heading_noise_deg) for each in together.conditions()] == [
        (0, 0),
        (0.2, 0.2),
        (0.4, 0.2),
    ]
    assert len(Grid(TWO, position_noises_m=(0, 1), heading_noises_deg=(0, 1, 2))) == 2 * 6


def test_penetration_is_an_option_of_the_environment_and_the_mildest_is_the_largest() -> None:
    grid = Grid(TWO, latencies_ms=(0, 100), penetrations=(0.1, 1), vary="one_by_one")
    assert [(each.latency_s, each.penetration) for each in grid.conditions()] == [(0, 0.1), (0, 1), (0.1, 1)]
    cell = Cell("late_fusion", Condition("crossing", penetration=0.1))
    assert environment_options(cell, {})["penetration"] == 0.1
    assert "penetration" not in environment_options(Cell("late_fusion", Condition()), {})
    usual = Grid(TWO, latencies_ms=(0, 100), penetrations=(None, 0.5), vary="one_by_one")
    assert [(each.latency_s, each.penetration) for each in usual.conditions()] == [(0, None), (0, 0.5), (0.1, None)]
    assert sorted([Condition(penetration=0.1), Condition()]) == [Condition(), Condition(penetration=0.1)]


def test_a_run_without_a_length_ends_with_its_episode() -> None:
    (cell,) = Grid(("no_fusion",), frames=None).cells()
    assert cell.frames is None and "max_cycles" not in environment_options(cell, {})


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"penetrations": (2,)}, r"penetrations must be in \[0, 1\]"),
        ({"policies": "late_fusion"}, "policies must be a list of at least one"),
        ({"policies": ()}, "policies must be a list of at least one"),
        ({"policies": ("late_fusion", "late_fusion()")}, "policies must be distinct"),
        ({"policies": (3,)}, "policies must be texts"),
        ({"latencies_ms": (0, -1)}, "latencies_ms must be a finite number >= 0, got -1"),
        ({"latencies_ms": ("0",)}, "latencies_ms must be"),
        ({"latencies_ms": 0}, "latencies_ms must be a list"),
        ({"losses": (2,)}, r"losses must be in \[0, 1\]"),
        ({"bandwidths_mbit_s": (0,)}, "bandwidths_mbit_s must be"),
        ({"seeds": (-1,)}, "seeds must be an integer"),
        ({"seeds": (1, 1)}, "seeds must be distinct"),
        ({"seeds": {1, 2}}, "seeds must be a list of at least one"),
        ({"seeds": range(10**12)}, "seeds must be a list of at most 100,000, got more"),
        ({"seeds": range(50_001)}, "seeds, policies and conditions must make at most 100,000 runs, got 100,002"),
        ({"frames": 0}, "frames must be an integer"),
        ({"pose": "together", "position_noises_m": (0, 1)}, "pose must be 'product'"),
        ({"position_noises_m": (1, 1)}, "must be distinct"),
        ({"options": {"latency_s": 1}}, "latency_s is not an option here: use latencies_ms"),
        ({"options": {"detector": object()}}, "detector must be plain data"),
        ({"options": [1]}, "options must be names and values"),
    ],
)
def test_what_is_no_grid_is_refused(given: dict[str, Any], message: str) -> None:
    with pytest.raises(InvalidValueError, match=message):
        Grid(**({"policies": TWO} | given))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("policies: [late_fusion]\nlatency_ms: [0]\n", ":2: unknown key 'latency_ms'. Did you mean 'latencies_ms'"),
        ("policies: [late_fusion]\nlosses: [0, 2]\n", ":2: losses must be in [0, 1], got 2"),
        ("policies: [late_fusion]\nseeds: [1]\nseeds: [2]\n", ":3: seeds is there twice"),
        ("policies: [late_fusion\nseeds: 1", ":2: this is no YAML"),
        ("- a\n", ":1: file: expected keys and values"),
        (
            "policies: [late_fusion]\n\noptions:\n  vehicles: 8\n  lidr: null\n",
            ":5: unknown option 'lidr'. Did you mean",
        ),
        ("policies: [late_fusion]\noptions:\n  vehicles: -8\n", ":3: vehicles must be"),
        ("seeds: [1]\npolicies: [late_fusoin]\n", ":2: unknown policy 'late_fusoin'. Did you mean 'late_fusion'"),
        (
            "policies: [late_fusion]\nscenarios: [crosing]\n",
            ":2: unknown environment 'crosing'. Did you mean",
        ),
        (
            "policies: [late_fusion]\nscenarios: [replay]\n",
            ":2: scenarios must be simulated, got 'replay'",
        ),
        ("policies: [late_fusion]\nseeds: [2001-99-99]\n", ":2: seeds cannot be read: month must be in 1..12"),
        ("policies: [late_fusion]\n\noptions: {'a(': 1}\n", ":3: unknown option 'a('"),
        ("policies: [late_fusion]\noptions: {weather: {rain: 1}}\n", ":2: unknown weather option 'rain'. Did you mean"),
        ("policies: [late_fusion]\noptions: {channel: {loss: 1}}\n", ":2: channel must be without loss"),
    ],
)
def test_a_file_is_told_where_it_is_wrong(text: str, message: str, tmp_path: Path) -> None:
    path = tmp_path / "grid.yaml"
    path.write_text(text)
    with pytest.raises(GridFileError, match=re.escape(str(path) + message)):
        try_out(path)


def try_out(path: Path) -> None:
    """As the command does."""
    source = find_grid(path=path)
    try:
        check(source.grid())
    except CoopsimError as error:
        raise source.blame(error) from error


@pytest.mark.parametrize("own", ["channel: {range_m: 60}", "localization: {cav_0: {pose: {position_noise_m: 3}}}"])
def test_a_scenario_says_nothing_beside_the_grids_conditions(own: str, tmp_path: Path) -> None:
    path = tmp_path / "mine.yaml"
    path.write_text(f"scenario: crossing\noptions:\n  lidar: null\n  {own}\n")
    with pytest.raises(InvalidValueError, match=f"scenarios must have no {own.partition(':')[0]} of their own"):
        check(Grid(("late_fusion",), scenarios=(str(path),)))


def test_a_file_loses_nothing_and_what_is_given_goes_before_it(tmp_path: Path) -> None:
    path = tmp_path / "grid.yaml"
    path.write_text(
        "policies: [late_fusion(delayed=replay)]\nlatencies_ms: [0, 100]\noptions: {vehicles: 8, lidar: null}\n"
    )
    grid = find_grid(path=path, more_policies=["no_fusion"], seeds=(4,), options={"vehicles": 9}).grid()
    assert grid.policies == ("late_fusion(delayed=replay)", "no_fusion") and grid.latencies_ms == (0, 100)
    assert grid.seeds == (4,) and grid.options == {"vehicles": 9, "lidar": None}
    assert find_grid(path=path, policies=TWO).grid().policies == TWO
    with pytest.raises(InvalidValueError, match=r"^losses must be"):  # not the file's fault
        find_grid(path=path, losses=(3,)).grid()
    path.write_text("policies: late_fusion\n")
    with pytest.raises(GridFileError, match=":1: policies must be a list"):
        find_grid(path=path, more_policies=["no_fusion"]).grid()
    with pytest.raises(GridFileError, match=r"cannot read .*nowhere\.yaml: No such file"):
        find_grid(path=tmp_path / "nowhere.yaml")
    with pytest.raises(InvalidValueError, match="policies must be at least one"):
        find_grid().grid()
    with pytest.raises(InvalidValueError, match="one grid too many"):
        find_grid("quick", path)
    with pytest.raises(UnknownNameError, match="Did you mean 'quick'"):
        find_grid("quik")


@pytest.mark.parametrize("name", PRESETS)
def test_every_preset_can_be_run(name: str) -> None:
    reads_sweeps = name in ("paper", "paper_disturbed", "safety_networks", "lies_places", "lies_networks")
    if reads_sweeps and name != "lies_places":
        pytest.importorskip("torch")
    few = {} if name.startswith("safety") or name == "driving" else {"vehicles": 6}
    blind = {} if reads_sweeps else {"lidar": None}
    grid = find_grid(name, options=few | blind).grid()
    require_count(2, policies=len(grid.policies))
    check(grid)


def test_presets_are_what_they_are_called() -> None:
    disturbing = {"bandwidth", "latency", "lies", "lies_networks", "lies_places", "loss", "pose"}
    others = {"driving", "leaderboard", "paper", "paper_disturbed", "quick", "safety", "safety_networks", "warm_up"}
    assert set(PRESETS) == disturbing | others
    latency, pose, quick = (find_grid(name).grid() for name in ("latency", "pose", "quick"))
    assert (min(latency.latencies_ms), max(latency.latencies_ms)) == (0, 500)
    poses = [(each.position_noise_m, each.heading_noise_deg) for each in pose.conditions()]
    assert (min(poses), max(poses)) == ((0, 0), (1, 1)) and all(position == heading for position, heading in poses)
    assert (len(quick.latencies_ms), len(quick.seeds), quick.frames) == (4, 3, 100)


def test_the_safety_preset_changes_one_thing_at_a_time_and_uses_no_seed_for_tuning() -> None:
    grid = find_grid("safety").grid()
    conditions = [each for each in grid.conditions() if each.scenario == grid.scenarios[0]]
    assert len(conditions) == 1 + 3 + 2 + 2 + 2 and {each.latency_s for each in conditions} == {0, 0.1, 0.3, 0.5}
    assert grid.frames is None and min(grid.seeds) >= 1000
    assert set(find_grid("safety_networks").grid().scenarios) == set(grid.scenarios)


def test_the_papers_preset_has_every_policy_that_has_weights_undisturbed() -> None:
    pytest.importorskip("torch")
    grid = find_grid("paper").grid()
    named = {PolicySpec.parse(policy).policy_class() for policy in grid.policies}
    known = {coopsim.POLICIES.get(name) for name in coopsim.POLICIES.names() if name != "truth"}  # no competitor
    without = {coopsim.POLICIES.get(name) for name in grid.left_out}
    assert named == known - without
    assert len(grid.policies) == len(named) + 4  # late_fusion is there in three ways, where2comm and gsaf in two
    assert list(grid.conditions()) == [Condition("town")]
    places = {PlaceSeeds(grid.options.get("place_seed")).of(seed) for seed in grid.seeds}
    assert len(places) == len(grid.seeds) == 12
    for trained in (WorldRecipe(), WorldRecipe.for_validation()):
        assert not places & set(range(trained.first_place, trained.first_place + trained.places))


def test_the_main_policies_are_disturbed_one_thing_at_a_time_where_the_others_are_not() -> None:
    pytest.importorskip("torch")
    undisturbed, grid = find_grid("paper").grid(), find_grid("paper_disturbed").grid()
    assert (grid.seeds, grid.frames, grid.options) == (undisturbed.seeds, undisturbed.frames, undisturbed.options)
    names = {PolicySpec.parse(policy).policy_class() for policy in grid.policies}
    assert names < {PolicySpec.parse(policy).policy_class() for policy in undisturbed.policies}
    conditions = list(grid.conditions())
    assert len(conditions) == 1 + 4 == len(set(conditions))
    mildest = Condition("town")
    assert mildest in conditions
    for each in conditions:
        pose = (each.position_noise_m, each.heading_noise_deg) != (0, 0)
        changed = (each.latency_s > 0, each.loss > 0, pose, each.bandwidth_bit_s < math.inf)
        assert sum(changed) == (each != mildest)


def test_all_are_the_others_that_have_weights(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("torch")

    class Untrained(coopsim.Policy):
        def __init__(self) -> None:
            raise WeightsNotShippedError("no weights of 'untrained' ship yet")

        def track(self, agent: str, observation: Observation) -> Tracks:
            raise NotImplementedError

    monkeypatch.setitem(coopsim.POLICIES._entries, "untrained", Untrained)
    grid = Grid(("ab3dmot(hits=2)", "all", "late_fusion(delayed=replay)"))
    assert (grid.policies[0], grid.policies[-1]) == ("ab3dmot(hits=2)", "late_fusion(delayed=replay)")
    rest = grid.policies[1:-1]
    assert grid.left_out["untrained"] == "no weights of 'untrained' ship yet"
    assert {*rest, *grid.left_out} == {*coopsim.POLICIES.names()} - {"no_fusion", "late_fusion", "truth"}
    assert not {*rest} & {*grid.left_out} and Grid(TWO).left_out == {}
    with pytest.raises(WeightsNotShippedError, match="untrained"):  # who names one is told
        check(Grid(("untrained",)))


def test_one_by_one_counts_both_noises_of_a_pose_as_one_only_together() -> None:
    noises: dict[str, Any] = {"position_noises_m": (0, 0.2), "heading_noises_deg": (0.1, 0.3), "latencies_ms": (300, 0)}
    apart = list(Grid(TWO, **noises, vary="one_by_one").conditions())
    assert [(each.latency_s, each.position_noise_m, each.heading_noise_deg) for each in apart] == [
        (0.3, 0, 0.1),
        (0, 0, 0.1),
        (0, 0, 0.3),
        (0, 0.2, 0.1),
    ]
    assert len(Grid(TWO, **noises, vary="one_by_one", pose="together")) == 2 * 3
    with pytest.raises(UnknownNameError, match="vary"):
        Grid(TWO, vary="singly")  # type: ignore[arg-type]


def test_a_condition_becomes_options() -> None:
    cell = Cell(
        "late_fusion",
        Condition("crossing", latency_s=0.2, loss=0.1, position_noise_m=0.3, heading_noise_deg=0.5),
        0,
        50,
    )
    plain = environment_options(cell, {"vehicles": 8, "weather": {"rain_mm_h": 5}})
    assert (plain["latency_s"], plain["loss"], plain["position_noise_m"]) == (0.2, 0.1, 0.3)
    assert plain["heading_noise_rad"] == math.radians(0.5) and plain["max_cycles"] == 50
    assert plain["weather"] == {"rain_mm_h": 5} and "channel" not in plain


def test_a_bandwidth_changes_nothing_else_of_the_channel() -> None:
    """The whole channel that a limit needs has the latency, loss, jitter and range that the plain options make."""
    given = {"latency_jitter_s": 0.02, "communication_range_m": 80.0}
    narrow, free = (
        environment_options(
            Cell("late_fusion", Condition("crossing", latency_s=0.2, loss=0.1, bandwidth_bit_s=rate)), given
        )
        for rate in (1e5, math.inf)
    )
    limited = channel_config(narrow["channel"])
    assert limited.bandwidth is not None and limited.bandwidth.rate_bit_s == 1e5
    env = coopsim.parallel_env("crossing", **(free | {"vehicles": 4, "lidar": None}))
    plain = env._options.channel_config
    assert (limited.latency, limited.loss, limited.range_m) == (plain.latency, plain.loss, plain.range_m)


def test_a_bandwidth_leaves_a_scenario_its_jitter_and_range(tmp_path: Path) -> None:
    file = tmp_path / "mine.yaml"
    said = "communication_range_m: 80, latency_jitter_s: 0.02"
    file.write_text(f"scenario: crossing\noptions: {{lidar: null, {said}}}\npopulation: {{vehicles: 4}}\n")
    grid = Grid(("late_fusion",), scenarios=(str(file),), bandwidths_mbit_s=(0.1, math.inf), latencies_ms=(200,))
    check(grid)
    limited, free = (
        coopsim.parallel_env(file, **environment_options(cell, grid.options))._options.channel_config
        for cell in grid.cells()
    )
    assert limited.bandwidth is not None and (limited.range_m, limited.latency.jitter_s) == (80.0, 0.02)  # type: ignore[attr-defined]
    assert (limited.latency, limited.loss, limited.range_m) == (free.latency, free.loss, free.range_m)
    beside = environment_options(grid.cells()[0], {"communication_range_m": 60.0})
    assert channel_config(beside["channel"]).range_m == 60.0


def test_a_channel_may_be_a_file(tmp_path: Path) -> None:
    (tmp_path / "radio.yaml").write_text("radio: {scene: urban}")
    cell = Cell("late_fusion", Condition(latency_s=0.2))
    made = environment_options(cell, {"channel": str(tmp_path / "radio.yaml")})
    assert made["channel"] == environment_options(cell, {"channel": {"radio": {"scene": "urban"}}})["channel"]


@pytest.mark.parametrize(
    ("channel", "message"),
    [
        ("nowhere.yaml", "channel: cannot read nowhere.yaml"),
        (3, "channel must be None, a mapping or the path of a YAML file"),
        ({"latency": {"model": "gamma"}}, "channel must be without latency"),
        ({"bandwidth": {"rate_bit_s": 1.0}}, "channel.bandwidth must be a mapping without rate_bit_s"),
    ],
)
def test_a_channel_beside_the_grid_leaves_it_what_is_its(channel: Any, message: str) -> None:
    with pytest.raises(InvalidValueError, match=message):
        environment_options(Cell("late_fusion", Condition()), {"channel": channel})


@pytest.mark.parametrize("name", ["quick", "latency", "bandwidth", "paper", "paper_disturbed"])
def test_every_receiver_gives_the_best_answer_it_has_to_delayed_messages(name: str) -> None:
    """Otherwise a table under latency compares defaults, not methods; `late_fusion` shows both."""
    if name.startswith("paper"):
        pytest.importorskip("torch")
    policies = set(find_grid(name).grid().policies)
    # Networks are told how late messages are.
    policies = {each for each in policies if not issubclass(PolicySpec.parse(each).policy_class(), PerceivingPolicy)}
    assert {"late_fusion(delayed=as_current)", "late_fusion(delayed=replay)"} <= policies
    for text in policies - {"no_fusion", "late_fusion(delayed=as_current)", "late_fusion(delayed=predict)"}:
        best = "predict" if text.startswith("track_to_track") else "replay"  # tracks have no measurements to replay
        assert PolicySpec.parse(text).parameters["delayed"] == best, text


def test_the_page_of_situations_counts_the_cells_of_its_command() -> None:
    page = (Path(__file__).parents[4] / "docs/reference/situations.md").read_text(encoding="utf-8")
    command = next(
        each for each in re.findall(r"```\n(coopsim bench .*?)```", page, re.DOTALL) if "calibration" in each
    )
    words = shlex.split(command.replace("\\\n", " "))
    parser = Parser()
    BENCH.add_arguments(parser)
    options = parser.parse_args(words[2:])
    given = flag_values(options)
    cells, whole = len(list(find_grid("safety", **given).grid().cells())), len(list(find_grid("safety").grid().cells()))
    assert f"These are {cells:,} runs" in page and f"The whole preset has {whole:,}." in page
