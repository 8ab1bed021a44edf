"""Ray: its import, and its start on this machine or as part of a cluster."""

from __future__ import annotations

import importlib
import os
from typing import Any

from coopsim.errors import InvalidValueError, MissingDependencyError
from coopsim.support.precision import PRECISION, arithmetic
from coopsim.support.processes import ONE_THREAD


def ray_environment() -> dict[str, Any]:
    """Return Ray's "runtime environment" of tasks and actors: one thread, and our arithmetic on any machine."""
    return {"env_vars": {**ONE_THREAD, PRECISION: arithmetic()}}


def import_ray() -> Any:
    """Return the module `ray`.

    Raises:
        MissingDependencyError: it is not installed.
    """
    try:
        return importlib.import_module("ray")
    except ImportError as error:
        raise MissingDependencyError("Ray needs the package ray: pip install 'coopsim[ray]'") from error


def start_ray(ray: Any, workers: int | None, address: str | None) -> None:
    """Start Ray.

    Args:
        ray: the module.
        workers: processes at once on this machine; None, or on a cluster: one for each core.
        address: of a cluster, as `ray.init` takes it; None: `RAY_ADDRESS`, or else this machine alone.

    Raises:
        InvalidValueError: there is no cluster at the address.
    """
    address = address or os.environ.get("RAY_ADDRESS") or "local"
    # What is stored is small, and Ray's default would take a third of the machine's memory.
    here = {"num_cpus": workers, "include_dashboard": False, "object_store_memory": 100 * 2**20}
    try:
        ray.init(
            address=address,
            runtime_env=ray_environment(),
            log_to_driver=False,
            logging_level="ERROR",
            **(here if address == "local" else {}),
        )
    except (ConnectionError, ValueError, RuntimeError) as error:
        raise InvalidValueError(f"address must be that of a Ray cluster, got {address!r}: {error}") from error
