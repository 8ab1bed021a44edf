"""Places are the same on every processor: drawn anew with other kernels of BLAS and fewer instructions."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest
from representatives import all_of

SCRIPT = Path(__file__).parents[2] / "scripts" / "place_digests.py"

_UMATH = np._core._multiarray_umath  # type: ignore[attr-defined]
FEATURES = [name for name in _UMATH.__cpu_dispatch__ if _UMATH.__cpu_features__.get(name)]
"""Instructions that numpy uses here where there are some."""

NO_SIMD = {
    "NPY_DISABLE_CPU_FEATURES": " ".join(FEATURES),
    "GLIBC_TUNABLES": "glibc.cpu.hwcaps=-AVX2,-FMA,-AVX512F,-AVX",
}
NEEDS = {"Prescott": "SSE3", "Nehalem": "SSE42", "Sandybridge": "AVX", "Haswell": "AVX2", "SkylakeX": "AVX512_SKX"}
"""Families of OpenBLAS's kernels, and what a processor must have to run them."""

KERNELS = [name for name, feature in NEEDS.items() if _UMATH.__cpu_features__.get(feature)]
FEW = "0,23"  # towns that came out differently before drawing was exact
MANY = "0-299"


@lru_cache
def drawn(towns: str, kernels: str, simd: bool = True) -> dict[str, dict[str, str]]:
    """Return the digests of the parts of towns and of all built-in places, by a process with other settings."""
    settings = {"OPENBLAS_CORETYPE": kernels, **({} if simd else NO_SIMD)}
    found = subprocess.run(
        [sys.executable, SCRIPT, "--named", "--towns", towns],
        env={**os.environ, "OMP_NUM_THREADS": "1", **settings},
        capture_output=True,
        check=True,
    )
    lines = [json.loads(line) for line in found.stdout.splitlines()]
    return {line["place"]: line["parts"] for line in lines}


@pytest.mark.parametrize("towns", all_of([FEW, MANY], FEW))
@pytest.mark.parametrize("kernels", all_of(KERNELS, KERNELS[-1]))  # those that differ most from the oldest
def test_places_are_the_same_whatever_kernels_blas_has(towns: str, kernels: str) -> None:
    assert drawn(towns, kernels) == drawn(towns, "Prescott", simd=False)


@pytest.mark.skipif(len(KERNELS) < 4 or not FEATURES, reason="needs a processor with SIMD that can be switched off")
def test_the_settings_are_others() -> None:
    # If the sums of BLAS and the functions of numpy had the same bits in all settings, the tests above could not fail.
    # Which functions have others depends on the processor: without AVX-512 it is exp, and not arctan2.
    code = (
        "import numpy as np; x = np.random.default_rng(0).normal(size=(64, 2)); "
        "print((x @ x.T).tobytes().hex(), np.arctan2(*x.T).tobytes().hex() + np.exp(x).tobytes().hex())"
    )
    settings = [{"OPENBLAS_CORETYPE": "Haswell"}, {"OPENBLAS_CORETYPE": "Prescott", **NO_SIMD}]
    one, other = (
        subprocess.run([sys.executable, "-c", code], env=os.environ | each, capture_output=True, check=True).stdout
        for each in settings
    )
    for a, b in zip(one.split(), other.split(), strict=True):
        assert a != b
