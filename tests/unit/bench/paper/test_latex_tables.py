"""LaTeX tables: they are well formed, whatever policies are called, and their marks say what was tested."""

from __future__ import annotations

import re
import shutil
import subprocess
from dataclasses import replace
from pathlib import Path

import pytest
from synthetic_results import results

from coopsim.bench.grid.cell import Condition
from coopsim.bench.paper.tables import escape, latex_tables
from coopsim.bench.results.result_table import ResultTable
from coopsim.errors import UnknownNameError

CONDITIONS = [
    Condition("crossing", latency_s=latency_s, position_noise_m=noise, heading_noise_deg=noise)
    for latency_s, noise in ((0.0, 0.0), (0.1, 0.0), (0.5, 0.0), (0.0, 0.2))
]
ODD = "50%_off & {more}"
TABLE = ResultTable.of(results({"good(hits=2)": 60.0, "twin": 60.0, ODD: 30.0}, CONDITIONS, range(8)))
METRICS = ("sAMOTA", "IDS")


def rows(text: str) -> list[list[str]]:
    """The cells of each row between the rules."""
    body = text.split(r"\midrule")[1].split(r"\bottomrule")[0]
    return [re.split(r"(?<!\\)&", line.strip().removesuffix(r"\\")) for line in body.strip().splitlines()]


def test_a_table_for_the_undisturbed_and_one_for_each_axis() -> None:
    tables = latex_tables(TABLE, METRICS)
    assert set(tables) == {"undisturbed.tex", "sAMOTA_latency.tex", "sAMOTA_position_noise_and_heading_noise.tex"}
    heads = [line for line in tables["sAMOTA_latency.tex"].splitlines() if line.strip().startswith("policy")]
    assert heads == [r"    policy & 0 ms & 100 ms & 500 ms \\"]
    assert r"0.2 m and 0.2 $^\circ$ \\" in tables["sAMOTA_position_noise_and_heading_noise.tex"]
    assert r"policy & sAMOTA & IDS & bytes/s \\" in tables["undisturbed.tex"]
    with pytest.raises(UnknownNameError, match="metric"):
        latex_tables(TABLE, ["nothing"])


@pytest.mark.parametrize("name", sorted(latex_tables(TABLE, METRICS)))
def test_it_is_well_formed(name: str) -> None:
    text = latex_tables(TABLE, METRICS)[name]
    plain = re.sub(r"\\[\\{}&%$#_]", "", text)
    assert plain.count("{") == plain.count("}") and plain.count("$") % 2 == 0
    assert not re.search(r"[%#_~^<>]", re.sub(r"\$[^$]*\$", "", plain).replace(r"\label{tab:", ""))
    begun, ended = (re.findall(rf"\\{word}{{(\w+)}}", text) for word in ("begin", "end"))
    assert begun == list(reversed(ended)) == ["table", "tabular"]
    columns = len(re.search(r"{tabular}{(l r*)}".replace(" ", ""), text)[1])  # type: ignore[index]
    assert {len(row) for row in rows(text)} == {columns} and len(rows(text)) == 3
    assert all(rule in text for rule in (r"\toprule", r"\midrule", r"\bottomrule", r"\caption{", r"\label{tab:"))
    assert text.isascii()


@pytest.mark.skipif(shutil.which("pdflatex") is None, reason="no LaTeX is installed")
def test_a_document_with_all_of_them_compiles(tmp_path: Path) -> None:
    letters = escape("".join(map(chr, range(32, 127))) + "°±")
    body = "\n".join([*latex_tables(TABLE, METRICS).values(), letters])
    text = f"\\documentclass{{article}}\\usepackage{{booktabs}}\n\\begin{{document}}\n{body}\n\\end{{document}}\n"
    (tmp_path / "paper.tex").write_text(text)
    command = ["pdflatex", "-interaction=nonstopmode", "-halt-on-error", "paper.tex"]
    run = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True)
    assert run.returncode == 0 and (tmp_path / "paper.pdf").stat().st_size > 0, run.stdout


def test_the_best_is_bold_and_what_it_does_not_beat_has_a_star() -> None:
    first, second, third = rows(latex_tables(TABLE, METRICS)["undisturbed.tex"])
    assert {first[0].strip(), second[0].strip()} == {"good", "twin"}
    assert third[0].strip() == r"50\%\_off \& \{more\}"
    assert r"\textbf" in first[1] and r"\textbf" in first[2]  # of IDS the fewest
    assert "^*" in second[1] and r"\textbf" not in second[1] + third[1] and "^*" not in third[1]
    value = TABLE.values("sAMOTA")[TABLE.policies.index(ODD), 0].mean()
    assert third[1].strip().startswith(f"{value:.1f} ") and r"$\pm$" in third[1]
    assert third[3].strip() == "0" and first[3].strip() == r"1\,500"


def test_too_few_seeds_and_lacking_runs_are_told() -> None:
    few = results({"a": 60.0, "b": 30.0}, CONDITIONS[:2], range(3))
    told = latex_tables(ResultTable.of(few), METRICS)["undisturbed.tex"]
    assert "none can be significantly better with 3 seeds: it takes 6" in told and "brackets" not in told
    lacking = [each for each in few if each.cell != few[0].cell]
    told = latex_tables(ResultTable.of(lacking), METRICS)["undisturbed.tex"]
    assert "in brackets what lacks runs" in told
    assert rows(told)[-1][0].strip() == few[0].cell.policy and rows(told)[-1][1].strip().startswith("(")


def test_a_negative_value_has_a_minus() -> None:
    low = [replace(each, values={"MOTA": -5.0 - each.cell.seed}) for each in results(conditions=CONDITIONS[:1])]
    cells = [row[1] for row in rows(latex_tables(ResultTable.of(low), ["MOTA"])["undisturbed.tex"])]
    assert all("$-6.0$" in cell for cell in cells)


def test_every_letter_is_shown() -> None:
    assert escape("a_b%\n c\\d") == r"a\_b\% c\textbackslash{}d"
