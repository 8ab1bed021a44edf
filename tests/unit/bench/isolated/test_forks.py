"""Processes of policies, forked from one that has done what each would do anew."""

from __future__ import annotations

from pathlib import Path

from coopsim.bench.isolated.isolation import Isolation
from coopsim.catalog import PolicySpec

CODE = """
import coopsim
from coopsim.geometry import exact

class Mine(coopsim.Policy):
    needs = coopsim.Needs(uplink="none")
    method = "knows kernels" if exact.sin.types else "knows none"

    def track(self, agent, observation):
        raise NotImplementedError
"""


def test_kernels_are_prepared_before_a_policy_s_process_begins(tmp_path: Path) -> None:
    (tmp_path / "policy.py").write_text(CODE)
    with Isolation(60.0).policy(PolicySpec.parse(f"{tmp_path / 'policy.py'}:Mine")) as policy:
        assert policy.method == "knows kernels"
