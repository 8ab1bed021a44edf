"""The table that every command prints."""

from __future__ import annotations

from coopsim.bench.text.forms import COLUMNS
from coopsim.bench.text.score_text import format_table

NAMES = ["sAMOTA", "AMOTA", "AMOTP", "MOTA", "MOTP", "IDS", "FP", "FN", "bytes/s", "frames/s"]


def row(**change: float) -> dict[str, float]:
    return dict.fromkeys(NAMES, 12.345) | change


def test_columns_stand_in_the_order_of_published_tables() -> None:
    assert [name for name, _ in COLUMNS] == NAMES
    header = format_table([({"policy": "p", "latency": "0 ms"}, row())]).splitlines()[0]
    assert header.split() == ["policy", "latency", *NAMES]


def test_text_is_aligned_left_and_numbers_right() -> None:
    rows = [({"policy": "p"}, row(FP=1, FN=123456)), ({"policy": "a_long_name"}, row(FP=99999, IDS=0.25))]
    header, _, first, second = format_table(rows).splitlines()
    assert len(header) == len(first) == len(second)
    assert first.startswith("p  ") and second.startswith("a_long_name  ")
    for name in NAMES:
        end = header.index(f" {name}") + 1 + len(name)
        assert all(line[end - 1] != " " and line[end : end + 1] in (" ", "") for line in (first, second)), name


def test_values_are_rounded_to_what_they_mean() -> None:
    cells = format_table([({"policy": "p"}, row(IDS=0.25, FP=7.6, MOTA=-3.21))]).splitlines()[-1].split()
    shown = dict(zip(NAMES, cells[1:], strict=True))
    assert (shown["sAMOTA"], shown["MOTA"], shown["IDS"], shown["FP"], shown["bytes/s"]) == (
        "12.3",
        "-3.2",
        "0.2",
        "8",
        "12",
    )


def test_what_has_no_value_is_a_dash() -> None:
    cells = format_table([({"policy": "p"}, row(MOTP=float("nan")))]).splitlines()[-1].split()
    assert cells[1 + NAMES.index("MOTP")] == "-" and "nan" not in cells


def test_no_rows() -> None:
    assert format_table([]) == "no results"
