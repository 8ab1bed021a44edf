"""The script about errors on the road drives the episodes that messages decide, and says what changed."""

from __future__ import annotations

import json
from pathlib import Path

import measure_driving_errors as script
import pytest

from coopsim.localization.pose_noise import PoseNoise

HEAD = "policy,scenario,latency_s,loss,position_noise_m,heading_noise_deg,penetration,seed,crash"
SHARING = '"late_fusion(delayed=replay)"'


def test_episodes_are_those_in_which_only_a_car_alone_crashes_by_turns(tmp_path: Path) -> None:
    rows, crashes = (
        [HEAD],
        {("b", 1): (100, 0), ("b", 2): (100, 0), ("b", 3): (0, 0), ("a", 9): (100, 0), ("a", 8): (100, 100)},
    )
    for (scenario, seed), each in crashes.items():
        for policy, crash in zip(("no_fusion", SHARING), each, strict=True):
            rows.append(f"{policy},{scenario},0.0,0.0,0.0,0.0,0.3,{seed},{crash}")
    rows += [f"{policy},c,0.5,0.0,0.0,0.0,0.3,1,{crash}" for policy, crash in (("no_fusion", 100), (SHARING, 0))]
    (tmp_path / "results.csv").write_text("\n".join(rows))
    assert script.avoided(tmp_path / "results.csv") == [("a", 9), ("b", 1), ("b", 2)]


def test_one_error_is_the_same_for_all_agents() -> None:
    noise = PoseNoise(position_noise_m=1.0, heading_bias_rad=1.0)
    first, second = (script.OneError(noise, 5, agent, 0.1).step() for agent in ("cav_0", "cav_1"))
    assert first is not None and first.tolist() == second.tolist() and first.any()


def test_changes_are_from_the_first_case_of_a_group_over_what_all_have(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path, rows = tmp_path / "runs.jsonl", []
    for name, crashes in (("none", (0, 0, 100)), ("wrong", (100, 0))):
        for seed, crash in enumerate(crashes):
            numbers = {"crash": crash, "hard_brakes": 1.0, "phantom_brakes": 0.0, "time_lost": 2.0 + crash / 100}
            rows.append(json.dumps(["poses", name, "a", seed, numbers | {"bytes": 100.0, "denm": 0}]))
    path.write_text("\n".join(rows))
    script.tabulate(path)
    lines = capsys.readouterr().out.splitlines()
    assert lines[2].startswith("| poses | none | 2 | 0.00 (0 to 66) | 1.00 | 0.00 | 2.00 | 100 |")
    assert "| poses | wrong | 2 | 50.00 (9 to 91) (+50.00," in lines[3] and "; 0, 1) |" in lines[3]
    script.measure("poses", path, [])
    assert len(script.rows_of(path)) == 5
