"""`coopsim.vector`: many environments at once."""

from __future__ import annotations

import importlib
import os
from collections.abc import Callable, Sequence
from functools import partial
from inspect import signature
from pathlib import Path
from typing import Any, Literal, overload

from gymnasium.vector import AutoresetMode

from coopsim.envs.vector.crew import Crew, StartWorker
from coopsim.envs.vector.env_recipe import Recipe, Wrap
from coopsim.envs.vector.multi_agent import MultiAgentVector
from coopsim.envs.vector.on_ray import RayWorkers
from coopsim.envs.vector.process import Process
from coopsim.envs.vector.single_agent import SingleAgentVector
from coopsim.envs.vector.stepper import Stepper, require_vector_seed
from coopsim.envs.vector.worker import InProcess
from coopsim.errors import InvalidValueError, UnknownNameError
from coopsim.support.checks import require_choice, require_count
from coopsim.support.processes import cores

AGENTS = ("all", "single")
BACKENDS = ("local", "ray")


@overload
def vector(
    environment: str | Path, /, count: int, *, agents: Literal["single"], **options: Any
) -> SingleAgentVector: ...


@overload
def vector(
    environment: str | Path, /, count: int, *, agents: Literal["all"] | None = None, **options: Any
) -> MultiAgentVector: ...


@overload
def vector(
    environment: Callable[..., Any], /, count: int, *, agents: str | None = None, **options: Any
) -> SingleAgentVector | MultiAgentVector: ...


def vector(
    environment: str | Path | Callable[..., Any],
    /,
    count: int,
    *,
    workers: int | None = None,
    agents: str | None = None,
    wrap: Wrap | Sequence[Wrap] = (),
    seed: int | None = None,
    autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
    backend: str = "local",
    address: str | None = None,
    **options: Any,
) -> SingleAgentVector | MultiAgentVector:
    """Make `count` environments that are stepped together by worker processes.

    The same seed gives the same bits for any number of workers, and on Ray. Workers begin without the caller's script,
    so no `if __name__ == "__main__"` is needed; functions and classes of the script are sent along.

    Args:
        environment: name or scenario file, as of `coopsim.parallel_env`; or a function that returns an environment of
            gymnasium or of PettingZoo's parallel API, which gets `options`.
        count: number of environments.
        workers: number of processes that share them; 0 steps in the calling process, None is one for each core. There
            are never more than environments.
        agents: "all": each environment has all its agents, and the vector is a `MultiAgentVector`; "single": each is a
            `coopsim.single_env`, and the vector is a `SingleAgentVector`, which is gymnasium's `VectorEnv`. None is
            "all" for names; a function decides itself, and what is given must agree with what it makes.
        wrap: a wrapper, or several, the innermost first: each is called with an environment and returns one.
        seed: of the first `reset` without one; None: a fresh one.
        autoreset_mode: gymnasium's `AutoresetMode`, or its value: "NextStep", "SameStep", "Disabled".
        backend: "local" for processes of this machine, or "ray" for Ray actors, with at least one worker.
        address: of a Ray cluster, as `ray.init` takes it; None: `RAY_ADDRESS`, or else this machine alone.
        **options: of the environment.

    Returns:
        A `SingleAgentVector` or a `MultiAgentVector`, by `agents` or by what the function makes.

    Raises:
        UnknownNameError: no such environment, option, backend or choice of agents; the message lists the close ones.
        InvalidValueError: a value is not accepted.
        MissingDependencyError: Ray is not installed.
        LostEnvironmentsError: a worker died while it made its environments.
        Exception: what making an environment raised.
    """
    require_count(1, count=count)
    if workers is not None:
        require_count(0, workers=workers)
    if agents is not None:
        require_choice("agents", agents, AGENTS)
    require_choice("backend", backend, BACKENDS)
    if seed is not None:
        require_vector_seed(seed)
    if not (isinstance(environment, (str, Path)) or callable(environment)):
        raise InvalidValueError(f"environment must be a name, the path of a file or a function, got {environment!r}")
    if backend == "local" and workers != 0 and os.name != "posix":
        raise InvalidValueError("worker processes need POSIX (Linux, macOS): choose workers=0 or backend='ray'")
    mode = _autoreset_mode(autoreset_mode)
    recipe = Recipe(environment, agents, options, _wrappers(wrap)).packed()
    workers = min(count, cores() if workers is None else workers)
    start, stop = _starter(recipe, workers, backend, address)
    try:
        crew = Crew(start, count, max(workers, 1))
    except UnknownNameError as error:
        stop()
        if error.kind == "option" and error.name in options and not callable(environment):
            raise _unknown_option(error, agents) from error
        raise
    except BaseException:
        stop()
        raise

    def end() -> None:
        crew.end()
        stop()

    try:
        stepper = Stepper(crew, count, mode, seed)
        made = AGENTS[stepper.description.single]
        if agents not in (None, made):
            raise InvalidValueError(
                f"agents must be {made!r} or left out for what the environments are, got {agents!r}"
            )
        kind = SingleAgentVector if stepper.description.single else MultiAgentVector
        return kind(stepper, end)
    except BaseException:
        end()
        raise


def _starter(recipe: bytes, workers: int, backend: str, address: str | None) -> tuple[StartWorker, Callable[[], None]]:
    """Return what starts a worker, and what is called after the last has ended."""
    if backend == "ray":
        if workers < 1:
            raise InvalidValueError("workers must be >= 1 with backend 'ray', got 0")
        cluster = RayWorkers(workers, address)
        return partial(cluster.start, recipe), cluster.stop
    if address is not None:
        raise InvalidValueError(f"address is of a Ray cluster: it needs backend='ray', got {address!r}")
    return partial(Process if workers else InProcess, recipe), _nothing


def _unknown_option(error: UnknownNameError, agents: str | None) -> UnknownNameError:
    """Return the error with the vector's own arguments among what is accepted."""
    own = [name for name, each in signature(vector).parameters.items() if each.kind is each.KEYWORD_ONLY]
    where = error.where
    if error.name == "num_envs":
        where = "(the number of environments is `count`)"
    elif agents != "single" and error.name in signature(importlib.import_module("coopsim").single_env).parameters:
        where = 'without agents="single"'
    return UnknownNameError(error.kind, error.name, {*error.known, *own, "count"}, where)


def _nothing() -> None:
    """Do nothing."""


def _autoreset_mode(mode: object) -> AutoresetMode:
    try:
        return AutoresetMode(mode)
    except ValueError:
        accepted = ", ".join(repr(each.value) for each in AutoresetMode)
        raise InvalidValueError(f"autoreset_mode must be one of {accepted}, got {mode!r}") from None


def _wrappers(wrap: Wrap | Sequence[Wrap]) -> tuple[Wrap, ...]:
    wrappers = (wrap,) if callable(wrap) else wrap
    if not isinstance(wrappers, (list, tuple)) or not all(map(callable, wrappers)):
        raise InvalidValueError(f"wrap must be a function of an environment, or a list of these, got {wrap!r}")
    return tuple(wrappers)
