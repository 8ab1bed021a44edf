"""The protocol of a benchmark: it names all that others need, and the same results give the same text."""

from __future__ import annotations

import json
import math
import subprocess
from dataclasses import replace
from pathlib import Path

import pytest
from synthetic_results import results

from coopsim.bench.grid.grid import Grid
from coopsim.bench.paper import provenance as home
from coopsim.bench.paper.protocol_text import protocol_text
from coopsim.bench.paper.provenance import Provenance
from coopsim.bench.results.result_table import ResultTable
from coopsim.errors import StoreError

GIVEN = [replace(each, place_seed=2000 + each.cell.seed) for each in results({"good": 60.0, "bad": 30.0})]
TABLE = ResultTable.of(GIVEN)
TOWNS = {"known": True, "scenarios": [], "towns": [[100_000, 1_099_999]]}
PROVENANCE = Provenance(
    command="coopsim bench --preset paper",
    grid={"options": {"detector": "pillars"}, "vary": "one_by_one"},
    software={"coopsim": "1.2.3", "numpy": "4.5.6"},
    commit="c0ffee",
    sources="5ea",
    sends={"good": "features", "bad": "none"},
    weights={"good": ["good_net"]},
    sensing=["pillars"],
    digests={"good_net": "ab12", "pillars": "cd34", "mine": "ef56"},
    training={"good_net": TOWNS, "pillars": {"known": True}, "mine": {}},
    left_out={"cooptrack": "no weights of 'cooptrack' ship yet"},
)


def unwrapped(text: str) -> str:
    return text.replace("\n  ", " ")


def test_it_says_all_that_others_need() -> None:
    text = unwrapped(protocol_text(TABLE, PROVENANCE, ["sAMOTA"]))
    for said in (
        "coopsim bench --preset paper",
        "coopsim 1.2.3, numpy 4.5.6",
        "commit c0ffee",
        "sha256 5ea",
        "seeds: 0-2;",
        "frames a run: 40",
        "drawn places: 2000-2002",
        "latency (ms): 0, 100, 500",
        "bandwidth (Mbit/s): no limit",
        "one at a time",
        "get those of the detector pillars",
        "good: sends features; weights good_net",
        "bad: sends nothing",
        "left out: cooptrack: no weights",
        "good_net: ab12, trained in towns 100000 to 1099999 (none of the places here)",
        "pillars: cd34, trained on recordings",
        "mine: ef56, places unknown",
        "sAMOTA: ",
        "18 of 18 runs; 0 failed, 0 not run",
    ):
        assert said in text, said
    assert text == unwrapped(protocol_text(TABLE, PROVENANCE, ["sAMOTA"]))


def test_places_of_a_training_are_found_among_the_results() -> None:
    met = replace(PROVENANCE, training={"good_net": TOWNS | {"towns": [[2001, 1_099_999]]}})
    assert "2 of the 3 places here may be among them" in unwrapped(protocol_text(TABLE, met, []))
    named = [replace(each, place_seed=None) for each in GIVEN]
    known = replace(PROVENANCE, training={"good_net": {**TOWNS, "scenarios": ["crossing"], "towns": []}})
    text = unwrapped(protocol_text(ResultTable.of(named), known, []))
    assert "trained in crossing (1 of the 1 places here may be among them)" in text and "drawn places" not in text


def test_results_without_a_known_origin_have_a_protocol_still() -> None:
    text = protocol_text(ResultTable.of(GIVEN[:5]), Provenance(), ["sAMOTA"])
    assert "called from Python" in text and "Software" not in text and "Weights" not in text
    assert "5 of 18 runs; 0 failed, 13 not run" in protocol_text(ResultTable.of(GIVEN[:5]), Provenance(cells=18), [])
    assert "5 of 6 runs; 0 failed, 1 not run" in text


def test_a_provenance_survives_a_store_and_names_weights() -> None:
    pytest.importorskip("torch")
    grid = Grid(
        ("attfuse", "no_fusion"),
        bandwidths_mbit_s=(1, math.inf),
        options={"detector": "pillars", "vehicles": 6, "lidar": "VLP-16"},
    )
    found = Provenance.of(grid, "coopsim bench")
    assert found.sends == {"no_fusion": "none", "attfuse": "features"}
    assert found.weights == {"no_fusion": [], "attfuse": ["attfuse", "pillars"]} and found.sensing == ["pillars"]
    assert set(found.digests) == {"attfuse", "pillars"} and all(len(each) == 64 for each in found.digests.values())
    assert found.training["attfuse"]["towns"][0][0] == 100_000
    data = json.loads(json.dumps(found.as_data(), allow_nan=False))
    back = Provenance.from_data(data)
    assert back.grid["bandwidths_mbit_s"] == [1, math.inf]
    assert json.dumps(Provenance.from_data(back.as_data()).as_data()) == json.dumps(back.as_data())
    assert Provenance.from_data(None) == Provenance()
    with pytest.raises(StoreError, match="the provenance of the results is broken"):
        Provenance.from_data({"nothing": 1})


def test_a_commit_is_that_of_coopsims_own_repository(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def git(*words: str) -> None:
        who = ["-c", "user.name=a", "-c", "user.email=a@b"]
        subprocess.run(["git", "-C", str(tmp_path), *who, *words], check=True, capture_output=True)

    package = tmp_path / "site" / "coopsim"
    package.mkdir(parents=True)
    (package / "__init__.py").write_text("")
    monkeypatch.setattr(home.coopsim, "__file__", str(package / "__init__.py"))
    commit = home._commit.__wrapped__
    git("init")
    assert commit() == ""  # somebody else's repository, around an installation
    git("add", ".")
    git("commit", "-m", "x")
    assert len(commit()) == 40
    (package / "__init__.py").write_text("1")
    assert commit().endswith(", changed since")
