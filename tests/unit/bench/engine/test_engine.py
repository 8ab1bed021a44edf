"""Work in other processes, which know what the caller has registered."""

from __future__ import annotations

from dataclasses import dataclass

import pytest
from helpers.script_parts import forget, parts_of_a_script

from coopsim.bench.engine.engine import run_locally, run_work
from coopsim.interfaces.defense import DEFENSES
from coopsim.support.registrations import pack_registrations


@dataclass(frozen=True, eq=False)
class Ask:
    """Work that asks a registered defence."""

    def run(self) -> str:
        return str(DEFENSES.get("of_the_script")().judge(None)) if "of_the_script" in DEFENSES else "unknown"  # type: ignore[arg-type]

    def died(self, how: str) -> str:
        return how

    lost = died


@pytest.mark.usefixtures("started_anew")
def test_work_knows_what_the_script_has_registered() -> None:
    with parts_of_a_script():
        assert list(run_locally(iter([Ask()]), 1)) == ["(0.25, True)"]
        packed = pack_registrations()
    assert Ask().run() == "unknown"
    try:
        assert run_work(Ask(), packed) == "(0.25, True)"  # as on Ray
    finally:
        forget("of_the_script")
