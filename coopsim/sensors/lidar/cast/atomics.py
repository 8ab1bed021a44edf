"""Counters that compiled threads share: numba offers none on the CPU, but its compiler does."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numba import njit, types
from numba.core import cgutils
from numba.extending import intrinsic
from numpy.typing import NDArray

Counters = NDArray[np.int64]

_FOR_EVER = 2**62
_READS_PER_YIELD = 2000
_yield_core = types.ExternalFunction("sched_yield", types.int32())


def _on_counter(instruct: Callable[..., Any]) -> Callable[..., Any]:
    """Makes code of what `instruct` does with a builder, the address of `counters[index]`, and what other args are."""

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        kind = signature.args[0]
        array = context.make_array(kind)(context, builder, args[0])
        address = cgutils.get_item_pointer(context, builder, kind, array, [args[1]])  # type: ignore[no-untyped-call]
        return instruct(builder, address, *args[2:])

    return generate


def _add(typing: Any, counters: Any, index: Any, amount: Any) -> Any:
    """Add to a counter: (counters, index, amount) to what it was.

    Who sees the sum, by `read` or `add`, sees all that this thread wrote before.
    """
    return types.int64(counters, types.intp, types.int64), _on_counter(
        lambda builder, address, amount: builder.atomic_rmw("add", address, amount, "acq_rel")
    )


def _raise_to(typing: Any, counters: Any, index: Any, least: Any) -> Any:
    """Make a counter at least so large: (counters, index, least) to what it was."""
    return types.int64(counters, types.intp, types.int64), _on_counter(
        lambda builder, address, least: builder.atomic_rmw("max", address, least, "acq_rel")
    )


def _read(typing: Any, counters: Any, index: Any) -> Any:
    """What a counter is by now: (counters, index) to its value."""
    return types.int64(counters, types.intp), _on_counter(
        lambda builder, address: builder.load_atomic(address, "acquire", 8)
    )


add: Any = intrinsic(_add)
raise_to: Any = intrinsic(_raise_to)
read: Any = intrinsic(_read)


@njit(cache=True, nogil=True, error_model="numpy")
def wait_for(counters: Counters, index: int, least: int, yields: int = _FOR_EVER) -> bool:
    """Wait awake until a counter is at least so large.

    Args:
        counters: (N,) that other threads change.
        index: which.
        least: what it must reach.
        yields: after how many times to give up: about as many microseconds, if nobody else wants the core meanwhile.

    Returns:
        Whether it did.
    """
    for _ in range(yields):
        for _ in range(_READS_PER_YIELD):
            if read(counters, index) >= least:
                return True
        _yield_core()
    return False
