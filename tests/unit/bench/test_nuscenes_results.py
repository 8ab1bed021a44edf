"""Results of policies on a nuScenes export, and their scores: by ours, and by the official tools where they are."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from importlib.util import find_spec

import pytest

from coopsim.agents.policy import Policy
from coopsim.bench.nuscenes_results import DETECTION, TRACKING, score_results, write_results
from coopsim.cli.entry import main
from coopsim.data.export.export_run import export
from coopsim.data.export.nuscenes_records import SPLIT, VERSION
from coopsim.errors import InvalidValueError, RecordingError
from coopsim.types import Tracks

KIT = os.environ.get("COOPSIM_NUSCENES_PYTHON", sys.executable if find_spec("nuscenes") else "")
"""A Python that has nuscenes-devkit, which needs older packages than coopsim."""

EVALUATE = f"""
import json, sys
from nuscenes.eval.common.config import config_factory
from nuscenes.eval.tracking.evaluate import TrackingEval
evaluation = TrackingEval(config_factory("tracking_nips_2019"), sys.argv[2], "{SPLIT}", sys.argv[3], "{VERSION}",
                          sys.argv[1], verbose=False)
metrics, _ = evaluation.evaluate()
print("FOUND" + json.dumps(metrics.label_metrics))
"""


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    folder = tmp_path_factory.mktemp("run")
    options = {"connected_cars": 1, "rsus": 1, "vehicles": 14, "bicycles": 3, "lidar_columns": 256}
    export("nuscenes(key_frame_s=0.2)", "crossing", folder / "export", seeds=(3,), frames=24, **options)
    write_results(folder / "export", "no_fusion", folder / "results")
    return folder


def load(path):
    return json.loads(path.read_text())


def tables(run, name: str):
    return load(run / "export" / VERSION / f"{name}.json")


def perfect(run, path, identity=lambda record, stamp: record["instance_token"]) -> None:
    """Write the annotations themselves as a result."""
    names = {"vehicle.car": "car", "vehicle.bicycle": "bicycle", "human.pedestrian.adult": "pedestrian"}
    category = {each["token"]: each["name"] for each in tables(run, "category")}
    kind = {each["token"]: category[each["category_token"]] for each in tables(run, "instance")}
    stamp = {each["token"]: each["timestamp"] for each in tables(run, "sample")}
    results = {sample: [] for sample in stamp}
    for record in tables(run, "sample_annotation"):
        name = names.get(kind[record["instance_token"]])
        if name is not None and record["num_lidar_pts"] > 0:
            results[record["sample_token"]].append(
                {
                    **{key: record[key] for key in ("sample_token", "translation", "size", "rotation")},
                    "velocity": [0.0, 0.0],
                    "tracking_name": name,
                    "tracking_score": 1.0,
                    "tracking_id": identity(record, stamp[record["sample_token"]]),
                }
            )
    path.write_text(json.dumps({"meta": {}, "results": results}))


def test_a_result_has_every_sample_and_the_fields_of_the_task(run):
    samples = {sample["token"] for sample in tables(run, "sample")}
    for name, prefix in ((TRACKING, "tracking"), (DETECTION, "detection")):
        content = load(run / "results" / name)
        assert set(content["results"]) == samples
        boxes = [box for found in content["results"].values() for box in found]
        assert boxes
        for box in boxes:
            assert box["sample_token"] in samples
            assert isinstance(box[f"{prefix}_score"], float)
            assert box[f"{prefix}_name"] in ("car", "truck", "bus", "motorcycle", "bicycle", "pedestrian")
        assert content["meta"]["use_lidar"] is True


def test_tracks_are_on_the_exported_objects(run):
    found = score_results(run / "export", run / "results" / TRACKING)
    assert found["car"].best.tp > 2 * found["car"].best.fp  # in another world there are no matches


@pytest.mark.parametrize("frames", [2, 3, 4])  # key frames are 0 and 2: the last, or the one before, or both
def test_an_episode_may_end_in_a_key_frame(frames, tmp_path):
    options = {"connected_cars": 1, "rsus": 0, "vehicles": 3, "lidar_columns": 64}
    export("nuscenes(key_frame_s=0.2)", "crossing", tmp_path / "export", seeds=(3, 4), frames=frames, **options)
    results = write_results(tmp_path / "export", "no_fusion", tmp_path / "results")
    samples = {sample["token"] for sample in load(tmp_path / "export" / VERSION / "sample.json")}
    assert len(samples) == 2 * -(-frames // 2)
    assert set(load(results / TRACKING)["results"]) == set(load(results / DETECTION)["results"]) == samples


class Fails(Policy):
    """A policy that reports nothing, and fails in the third frame."""

    def track(self, agent, observation):
        if observation.time_ns == 200_000_000:
            raise InvalidValueError("a defect of the policy")
        return Tracks.empty()


def test_an_error_leaves_no_unfinished_file(run, tmp_path):
    with pytest.raises(InvalidValueError, match="a defect of the policy"):
        write_results(run / "export", f"{__file__}:Fails", tmp_path / "results")
    assert list((tmp_path / "results").iterdir()) == []


def test_the_truth_as_a_result_is_perfect(run, tmp_path):
    perfect(run, tmp_path / "truth.json")
    found = score_results(run / "export", tmp_path / "truth.json")
    assert {"car", "pedestrian"} <= set(found)
    for sweep in found.values():
        assert (sweep.amota, sweep.amotp) == pytest.approx((1.0, 0.0), abs=1e-6)
        assert (sweep.best.fp, sweep.best.fn, sweep.best.ids) == (0, 0, 0)


def test_new_identities_halfway_are_switches(run, tmp_path):
    half = sorted(sample["timestamp"] for sample in tables(run, "sample"))[len(tables(run, "sample")) // 2]
    perfect(run, tmp_path / "switched.json", lambda record, stamp: record["instance_token"] + str(stamp >= half))
    car = score_results(run / "export", tmp_path / "switched.json")["car"].best
    assert (car.fp, car.fn) == (0, 0)
    assert 0 < car.ids <= car.objects


def test_a_hole_in_a_track_is_filled(run, tmp_path):
    perfect(run, tmp_path / "holes.json")
    content = load(tmp_path / "holes.json")
    left_out = sorted(tables(run, "sample"), key=lambda sample: sample["timestamp"])[6]["timestamp"]
    for sample in tables(run, "sample"):
        if sample["timestamp"] == left_out:
            content["results"][sample["token"]] = []
    (tmp_path / "holes.json").write_text(json.dumps(content))
    car = score_results(run / "export", tmp_path / "holes.json")["car"].best
    assert (car.fp, car.ids) == (0, 0)
    assert car.fn < car.objects  # only those whose lives begin or end there are missed


def test_refusals(run, tmp_path):
    content = load(run / "results" / TRACKING)
    content["results"].popitem()
    (tmp_path / "short.json").write_text(json.dumps(content))
    with pytest.raises(RecordingError, match="must have every sample"):
        score_results(run / "export", tmp_path / "short.json")
    export("kitti", "crossing", tmp_path / "kitti", frames=1, lidar_columns=64, vehicles=3, connected_cars=1, rsus=0)
    with pytest.raises(InvalidValueError, match="must be an export as nuscenes, got one as kitti"):
        write_results(tmp_path / "kitti", "no_fusion", tmp_path / "results")
    with pytest.raises(InvalidValueError, match="control must be 'traffic'"):
        write_results(run / "export", "no_fusion", tmp_path / "driven", control="policy")


@pytest.mark.skipif(
    not KIT, reason="nuscenes-devkit is not installed: COOPSIM_NUSCENES_PYTHON may name a Python that has it"
)
def test_the_official_tools_agree(run, tmp_path):
    result = run / "results" / TRACKING
    command = [KIT, "-W", "ignore", "-c", EVALUATE, str(run / "export"), str(result), str(tmp_path)]
    told = subprocess.run(command, capture_output=True, text=True, check=True, cwd=tmp_path).stdout
    official = json.loads(told[told.index("FOUND") + len("FOUND") :])
    found = score_results(run / "export", result)
    assert {name for name, value in official["amota"].items() if value == value} == set(found)
    for name, sweep in found.items():
        theirs = {metric: values[name] for metric, values in official.items()}
        assert (sweep.amota, sweep.amotp) == pytest.approx((theirs["amota"], theirs["amotp"]), abs=1e-6)
        if sweep.best is None:
            continue
        best = sweep.best
        ours = {
            "mota": max(best.mota, 0.0),
            "motp": 2.0 * (1.0 - best.motp),
            "tp": best.tp - best.ids,  # a switch is no match there
            "fp": best.fp,
            "fn": best.fn,
            "ids": best.ids,
            "frag": best.frag,
            "ml": best.mostly_lost,
        }
        assert ours == pytest.approx({metric: theirs[metric] for metric in ours}, abs=1e-6)


def test_the_command_writes_results_and_prints_the_score(run, tmp_path, capsys):
    assert main(["export-results", str(run / "export"), "--policy", "no_fusion", "--out", str(tmp_path / "out")]) == 0
    told = capsys.readouterr().out
    assert load(tmp_path / "out" / TRACKING) == load(run / "results" / TRACKING)
    car = score_results(run / "export", run / "results" / TRACKING)["car"]
    assert f"car         {car.amota:7.3f}{car.amotp:7.3f}" in told
    assert main(["export-results", str(tmp_path), "--out", str(tmp_path / "out")]) == 2
    assert "export.json cannot be read" in capsys.readouterr().err
