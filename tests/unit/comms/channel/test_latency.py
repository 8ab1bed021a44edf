"""Delays have the moments they are asked for, and never run backwards."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from coopsim.comms.channel.latency import (
    MOST_S,
    EmpiricalLatency,
    GammaLatency,
    GaussianLatency,
    Latency,
    LogNormalLatency,
)
from coopsim.errors import InvalidValueError

NORMALS = np.random.default_rng(0).standard_normal(20_000)


@pytest.mark.parametrize("model", [GaussianLatency, LogNormalLatency, GammaLatency])
def test_mean_and_deviation_are_those_asked_for(model: type[Latency]) -> None:
    latency = model(0.1, 0.02)  # type: ignore[call-arg]
    delays = np.array([latency.delay_s(z) for z in NORMALS])
    assert delays.mean() == pytest.approx(0.1, rel=0.01)
    assert delays.std() == pytest.approx(0.02, rel=0.03)


def test_distributions_are_those_of_an_independent_implementation() -> None:
    """Quantiles against scipy.stats' own parametrization."""
    for z in (-3.0, -0.5, 0.0, 1.7, 4.0):
        p = stats.norm.cdf(z)
        spread = np.sqrt(np.log(1 + 0.5**2))
        wanted = stats.lognorm(s=spread, scale=0.1 * np.exp(-(spread**2) / 2)).ppf(p)
        assert LogNormalLatency(0.1, 0.05).delay_s(z) == pytest.approx(wanted, rel=1e-9)
        assert GammaLatency(0.1, 0.05).delay_s(z) == pytest.approx(stats.gamma(a=4, scale=0.025).ppf(p), rel=1e-6)


@given(
    mean_s=st.floats(1e-9, MOST_S),
    jitter_s=st.floats(0, MOST_S),
    seed=st.integers(0, 50),
    model=st.sampled_from([GaussianLatency, LogNormalLatency, GammaLatency]),
)
def test_any_delay_is_in_range_and_takes_one_draw(
    mean_s: float, jitter_s: float, seed: int, model: type[Latency]
) -> None:
    rng, reference = np.random.default_rng(seed), np.random.default_rng(seed)
    delay_ns = model(mean_s, jitter_s).draw_ns(rng)  # type: ignore[call-arg]
    reference.standard_normal()
    assert 0 <= delay_ns <= MOST_S * 1e9
    assert rng.random() == reference.random()


def test_empirical_delays_come_equally_often(tmp_path: Path) -> None:
    path = tmp_path / "delays.csv"
    path.write_text("delay_s\n0.3\n0.1\n\n0.2\n0.1\n")
    latency = EmpiricalLatency.from_csv(path)
    assert latency == EmpiricalLatency((0.3, 0.1, 0.2, 0.1))
    values, counts = np.unique([latency.delay_s(z) for z in NORMALS], return_counts=True)
    np.testing.assert_array_equal(values, [0.1, 0.2, 0.3])
    np.testing.assert_allclose(counts / len(NORMALS), [0.5, 0.25, 0.25], atol=0.015)
    assert latency.delay_s(40.0) == 0.3  # where the normal's distribution function is 1


@pytest.mark.parametrize("heading", ["delay_ms", "Latency [ms]", "latency (ms)", "MS", '"one-way delay, ms"'])
def test_a_heading_may_say_that_delays_are_milliseconds(tmp_path: Path, heading: str) -> None:
    path = tmp_path / "delays.csv"
    path.write_text(f"\ufeff{heading}\n120\n80\n")
    assert EmpiricalLatency.from_csv(path).samples_s == pytest.approx((0.12, 0.08))


@pytest.mark.parametrize("heading", ["delay_s", "items", "delay_s (not ms!) per item", "latency"])
def test_any_other_heading_leaves_them_seconds(tmp_path: Path, heading: str) -> None:
    path = tmp_path / "delays.csv"
    path.write_text(f"{heading}\n0.12\n")
    assert EmpiricalLatency.from_csv(path).samples_s == (0.12,)


@pytest.mark.parametrize(
    ("text", "match"),
    [
        ("delay_s\n0.1\nfast\n", "line 3: a delay is in .* 'fast'"),
        ("0.1\n-0.1\n", "line 2: a delay is in .* '-0.1'"),
        ("0.1\nnan\n", "line 2: a delay is in .* 'nan'"),
        ("0.1,0.2\n", "line 1: delays are one column, got 2"),
        ("delay_s\n", "at least one delay"),
        ("", "at least one delay"),
        ("0.1\ndelay_s\n0.2\n", "line 2: a delay is in .* 'delay_s'"),
        ("0.1\ninf\n", "line 2: a delay is in .* 'inf'"),
        ("0.1\n1e400\n", "line 2: a delay is in .* '1e400'"),
        ("0.1\n4000\n", r"line 2: a delay is in \[0, 3600\] s, got '4000'"),
        ("latency_ms\n-3\n", r"line 2: a delay is in \[0, 3.6e\+06\] ms, got '-3'"),
        ("100\n120\n90\n", "half of the delays are above 10 s.*the heading must end in \"ms\", got 'none'"),
        ("latency\n100\n120\n", "got 'latency'"),
        ("latency_s;size\n0.1;5\n", "line 2: a delay is in .* '0.1;5'"),
        ("0.1" + "9" * 140_000, "field larger than field limit"),
    ],
)
def test_a_broken_file_is_named(tmp_path: Path, text: str, match: str) -> None:
    path = tmp_path / "delays.csv"
    path.write_text(text)
    with pytest.raises(InvalidValueError, match=f"delays.csv.*{match}"):
        EmpiricalLatency.from_csv(path)


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(InvalidValueError, match=r"cannot read the delays in .*nothing\.csv"):
        EmpiricalLatency.from_csv(tmp_path / "nothing.csv")


@pytest.mark.parametrize(
    ("make", "match"),
    [
        (lambda: LogNormalLatency(0, 0.1), r"mean_s must be in \[1e-09, 3600\], got 0"),
        (lambda: GammaLatency(0.1, -1), r"jitter_s must be in \[0, 3600\], got -1"),
        (lambda: GammaLatency(0.1, float("inf")), "jitter_s"),
        (lambda: EmpiricalLatency(()), "samples_s must be at least one delay"),
        (lambda: EmpiricalLatency((0.1, float("nan"))), r"samples_s must be in \[0, 3600\], got nan"),
    ],
)
def test_bad_latency(make, match: str) -> None:  # type: ignore[no-untyped-def]
    with pytest.raises(InvalidValueError, match=match):
        make()
