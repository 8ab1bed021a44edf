"""Cheats get no rank: what an entry says of itself ranks nothing, and what ranks it cannot see, write or rebuild."""

from __future__ import annotations

import json
import os
import shutil
from pathlib import Path
from typing import Any

import pytest

import coopsim
from coopsim.bench.engine.engine import Engine
from coopsim.bench.entries import entry_checks
from coopsim.bench.entries.entry_checks import check_folder
from coopsim.bench.entries.entry_folder import EntryFolder
from coopsim.bench.entries.fixed_run import SCORED, WARM_UP, FixedRun
from coopsim.bench.entries.ranking import read_rankings
from coopsim.bench.isolated.isolation import Isolation
from coopsim.catalog import PolicySpec
from coopsim.cli import main
from coopsim.cli.arguments import FAILED, USER_ERROR
from tests.helpers import entries
from tests.helpers.entries import CARD

SECRET = b"0123456789abcdef, the salt"
TOWN: dict[str, Any] = {"lidar": None, "max_cycles": 4, **entries.SMALL}

pytestmark = pytest.mark.usefixtures("tiny_runs")


def salt_fd() -> str:
    """Return the number of an open file with the salt, as a shell hands it over."""
    reader, writer = os.pipe()
    os.write(writer, SECRET)
    os.close(writer)
    return str(reader)


def spec_of(folder: Path, code: str) -> PolicySpec:
    (folder / "policy.py").write_text(code)
    return PolicySpec.parse(f"{folder / 'policy.py'}:P")


def evaluated(spec: PolicySpec, isolation: Isolation, seed: int = 4000) -> coopsim.Evaluation:
    with isolation.policy(spec) as policy:
        return coopsim.evaluate(policy, "town", seed=isolation.seed(seed), **TOWN)


def repeated(folder: Path, run: FixedRun) -> list[str]:
    """Return what a check finds that repeats one cell of a run."""
    return list(entry_checks._rerun(run, EntryFolder.read(folder), 1, Engine(), Isolation(60.0)))


@pytest.fixture(scope="module")
def ranked(measured: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The organisers' folder, with the run of the honest entry."""
    out = tmp_path_factory.mktemp("ranked") / "runs"
    assert main(["entry", "score", str(measured), "--salt-fd", salt_fd(), "--out", str(out)]) == 0
    return out


def page_of(*words: object, capsys: pytest.CaptureFixture[str]) -> tuple[int, str, str]:
    """Return the status, the lines before the tables' end that rank, and all others."""
    capsys.readouterr()
    status = main(["entry", "page", *map(str, words)])
    ranks, _, others = capsys.readouterr().out.partition("Self-reported, without ranks")
    return status, ranks, others


def test_ranks_are_of_the_organisers_runs_alone(
    entry: Path, ranked: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    site = ("--out", tmp_path / "site", "--baseline", "mine")
    status, ranks, reported = page_of(entry, "--runs", ranked, "--salt-fd", salt_fd(), *site, capsys=capsys)
    assert status == 0 and "| 1 " in ranks and "| mine " in ranks and "| mine " in reported
    status, ranks, reported = page_of(entry, *site, capsys=capsys)
    assert status == 0 and ranks == "" and "| mine " in reported and "| 1 " not in reported
    page = (tmp_path / "site" / "index.html").read_text()
    assert "Self-reported, without ranks" in page and "it has no rank" in page and "Not isolated" in page


def test_c_forge_scores_by_hand_rank_nothing(
    entry: Path, ranked: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    forged = Path(shutil.copytree(entry, tmp_path / "forged"))
    (forged / "entry.yaml").write_text((forged / "entry.yaml").read_text().replace("name: mine", "name: forged"))
    scores = json.loads((forged / SCORED.file).read_text())
    scores["code"] = EntryFolder.read(forged).code()
    for cell in scores["cells"]:
        cell["values"] |= {"sAMOTA": 99.9, "bytes_per_s": 0.0}
    for run in (WARM_UP, SCORED):
        stored = json.loads((forged / run.file).read_text())
        run.write(forged, {**(scores if run is SCORED else stored), "code": scores["code"]})
    assert check_folder(forged) == [], "a page that runs nothing cannot know"
    words = entry, forged, "--runs", ranked, "--out", tmp_path / "site", "--baseline", "mine"
    _, ranks, reported = page_of(*words, capsys=capsys)
    assert "forged" not in ranks and "99.9" in reported
    (line,) = repeated(forged, SCORED)
    assert "scores.json differs in" in line


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("HOTA", 1_000_000),
        ("sAMOTA", 1e308),
        ("sAMOTA", float("inf")),
        ("sAMOTA", float("nan")),
        ("sAMOTA", True),
        ("sAMOTA", -1.0),
        ("HOTA", 10**400),
        ("bytes_per_s", -5),
        ("bytes_per_s", "0"),
        ("extra", 1.0),
    ],
)
def test_values_out_of_range_are_refused(entry: Path, name: str, value: Any) -> None:
    scores = json.loads((entry / SCORED.file).read_text())
    scores["cells"][0]["values"][name] = value
    (entry / SCORED.file).write_text(json.dumps(scores))
    (line,) = check_folder(entry)
    assert line.startswith("scores.json is broken: ")


@pytest.mark.parametrize("key", ["policy", "reads", "run", "software", "processor", "arithmetic", "code", "packages"])
@pytest.mark.parametrize("value", [[], {"a": []}, None, 3])
def test_keys_of_another_type_are_one_line(entry: Path, key: str, value: Any) -> None:
    scores = json.loads((entry / SCORED.file).read_text())
    (entry / SCORED.file).write_text(json.dumps({**scores, key: value}))
    (line,) = check_folder(entry)
    assert line.startswith("scores.json is broken: ")


@pytest.mark.parametrize("text", ["[" * 200_000, "{}", '{"cells": NaN}', "\udcff", '{"cells": ' + "9" * 5000 + "}"])
def test_files_that_are_no_scores_are_one_line(entry: Path, text: str) -> None:
    (entry / SCORED.file).write_bytes(text.encode(errors="surrogateescape"))
    (line,) = check_folder(entry)
    assert line.startswith(("scores.json is broken: ", "cannot read"))


def test_towns_of_other_seeds_are_refused(entry: Path) -> None:
    scores = json.loads((entry / SCORED.file).read_text())
    for cell in scores["cells"]:
        cell["place_seed"] = 1
    SCORED.write(entry, scores)
    assert ["of other towns" in line for line in check_folder(entry)] == [True]


def test_c_twin_and_c_salt_find_nothing_in_a_salted_run(tmp_path: Path) -> None:
    twin = spec_of(tmp_path, entries.TWIN)
    assert evaluated(twin, Isolation(60.0)).score["sAMOTA"] == 100.0, "public towns can be made again"
    salted, honest = Isolation(60.0, SECRET), PolicySpec.parse("late_fusion")
    wanted = evaluated(honest, salted).score.values
    assert evaluated(twin, salted).score.values == pytest.approx(dict(wanted), nan_ok=True)
    hunter = spec_of(tmp_path, entries.SALT)
    assert evaluated(hunter, salted).score.values == pytest.approx(dict(wanted), nan_ok=True)


def test_c_needs_is_asked_once_and_never_told_the_truth(tmp_path: Path) -> None:
    liar = spec_of(tmp_path, entries.NEEDS)
    honest = evaluated(PolicySpec.parse("late_fusion"), Isolation(60.0)).score.values
    assert coopsim.evaluate(liar.make(), "town", seed=4000, **TOWN).score["sAMOTA"] > honest["sAMOTA"], "it can cheat"
    assert evaluated(liar, Isolation(60.0)).score.values == pytest.approx(dict(honest), nan_ok=True)


def test_c_tele_does_no_better_than_alone(tmp_path: Path) -> None:
    reader = spec_of(tmp_path, entries.TELE)
    alone = evaluated(PolicySpec.parse("no_fusion"), Isolation(60.0)).score.values
    assert dict(coopsim.evaluate(reader.make(), "town", seed=4000, **TOWN).score.values) != dict(alone), "it can cheat"
    assert evaluated(reader, Isolation(60.0)).score.values == pytest.approx(dict(alone), nan_ok=True)


def test_c_patch_is_not_imported_by_its_check(entry: Path) -> None:
    before = entry_checks.differences
    (entry / "policy.py").write_text(entries.PATCH)
    code = EntryFolder.read(entry).code()
    for run in (WARM_UP, SCORED):
        scores = json.loads((entry / run.file).read_text()) | {"code": code}
        for cell in scores["cells"]:
            cell["values"]["sAMOTA"] = 77.7
        run.write(entry, scores)
    assert check_folder(entry) == []
    (line,) = repeated(entry, WARM_UP)
    assert "warm_up.json differs in" in line and "77.7" in line and entry_checks.differences is before


@pytest.mark.parametrize("name", ["card.md", "entry.yaml", "scores.json", ".hidden", "more/data"])
@pytest.mark.parametrize("kind", ["device", "pipe", "sparse", "loop"])
def test_hostile_folders_are_one_line(entry: Path, name: str, kind: str) -> None:
    path = entry / name
    path.parent.mkdir(exist_ok=True)
    path.unlink(missing_ok=True)
    if kind == "device":
        path.symlink_to("/dev/zero")
    elif kind == "pipe":
        os.mkfifo(path)
    elif kind == "sparse":
        path.write_bytes(b"")
        os.truncate(path, 40 * 2**30)
    else:
        path.symlink_to(".")
    (line,) = check_folder(entry)
    assert "must be a regular file" in line or "at most" in line


@pytest.mark.parametrize("name", [".hidden/answers", "__pycache__/policy.pyc", "runs/answers.py", "card.md", "coopsim"])
def test_every_file_is_digested(entry: Path, ranked: Path, name: str) -> None:
    rankings, lines = read_rankings(ranked, Isolation())
    assert EntryFolder.read(entry).digest in rankings and not lines
    (entry / name).parent.mkdir(exist_ok=True)
    (entry / name).write_text(CARD + "\nmore")
    lines = check_folder(entry)
    assert [line.startswith(f"{name} changed since") for line in lines] == [True, True]
    assert EntryFolder.read(entry).digest not in rankings


def test_names_do_not_steer_a_terminal(entry: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (entry / "entry.yaml").write_text(entries.ABOUT.format(name='"a\\e[2Jb\\u202e"', policy=entries.MINE))
    shutil.copytree(entry, tmp_path / "x\x1b[2Jy")
    capsys.readouterr()
    assert main(["entry", "page", str(tmp_path / "x\x1b[2Jy"), "--out", str(tmp_path / "site")]) == FAILED
    out = capsys.readouterr().out
    assert "name must be of printable characters" in out and "\x1b" not in out and "\u202e" not in out


def test_a_ranking_run_of_others_is_left_out(ranked: Path, tmp_path: Path, entry: Path) -> None:
    (file,) = ranked.iterdir()
    forged = Path(shutil.copytree(ranked, tmp_path / "runs"))
    ranking = json.loads(file.read_text())
    ranking["cells"][0]["values"]["sAMOTA"] = 99.0
    (forged / file.name).write_text(json.dumps(ranking))
    assert len(read_rankings(forged, Isolation())[0]) == 1, "without the salt a seal says nothing"
    found, (line,) = read_rankings(forged, Isolation(None, SECRET))
    assert not found and "has not the seal of this salt" in line
    assert SECRET.decode() not in file.read_text()
    for words in (["--out", str(tmp_path)], ["--salt-fd", salt_fd()]):
        assert main(["entry", "score", str(entry), *words]) == USER_ERROR
    inside = ["--salt-fd", salt_fd(), "--out", str(entry / "runs")]
    assert main(["entry", "score", str(entry), *inside]) == USER_ERROR


def test_rankings_of_another_salt_are_not_compared(ranked: Path, tmp_path: Path) -> None:
    (file,) = ranked.iterdir()
    runs = Path(shutil.copytree(ranked, tmp_path / "runs"))
    for name in ("x", "y"):
        ranking = json.loads(file.read_text()) | {"entry": "0" * 63 + str(ord(name) % 10), "salt": "1" * 64}
        (runs / f"{name}.json").write_text(json.dumps(ranking))
    found, (line,) = read_rankings(runs, Isolation())
    assert len(found) == 2 and file.name in line and "another salt" in line


def test_a_link_to_a_folder_is_no_entry(entry: Path, tmp_path: Path) -> None:
    (tmp_path / "link").symlink_to(entry)
    with pytest.raises(coopsim.CoopsimError, match="and no link"):
        check_folder(tmp_path / "link")
