"""`coopsim.vector`: many environments at once."""

from __future__ import annotations

import importlib
import os
import pickle
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from inspect import signature
from pathlib import Path
from typing import Any, Literal, overload

import cloudpickle
from gymnasium.vector import AutoresetMode

from coopsim.envs.vector.episodes import require_vector_seed
from coopsim.envs.vector.pools import CallingProcess, WorkerPool
from coopsim.envs.vector.stepper import Stepper
from coopsim.envs.vector.vectors import MultiAgentVector, SingleAgentVector
from coopsim.errors import InvalidValueError, UnknownNameError
from coopsim.support.checks import require_choice, require_count
from coopsim.support.processes import cores
from coopsim.support.registrations import pack_registrations

AGENTS = ("all", "single")

Wrap = Callable[[Any], Any]


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
    backend: str | None = None,
    **options: Any,
) -> SingleAgentVector | MultiAgentVector:
    """Make `count` environments that are stepped together by worker processes.

    The same seed gives the same bits for any number of workers. Workers begin without the caller's script,
    so no `if __name__ == "__main__"` is needed; functions and classes of the script are sent along.

    Args:
        environment: name or scenario file, as `coopsim.parallel_env` takes it; or a function that gets `options` and
            returns an environment of gymnasium or of PettingZoo's parallel API.
        count: number of environments.
        workers: number of processes that share them; 0 steps in the calling process, None is one for each core. There
            are never more than environments.
        agents: "all": each environment has all its agents, and the vector is a `MultiAgentVector`; "single": each is a
            `coopsim.single_env`, and the vector is a `SingleAgentVector`, which is gymnasium's `VectorEnv`. None is
            "all" for names; a function decides itself, and what is given must agree with what it makes.
        wrap: a wrapper, or several, the innermost first: each is called with an environment and returns one.
        seed: seed of the first `reset` without one; None: a fresh one.
        autoreset_mode: gymnasium's `AutoresetMode`, or its value: "NextStep", "SameStep", "Disabled".
        backend: deprecated; "local" is accepted for one more release.
        **options: options of the environment.

    Returns:
        A `SingleAgentVector` or a `MultiAgentVector`, by `agents` or by what the function makes.

    Raises:
        UnknownNameError: no such environment, option or choice of agents; the message lists the close ones.
        InvalidValueError: a value is not accepted.
        LostEnvironmentsError: a worker died while it made its environments.
        Exception: an error in making an environment.
    """
    require_count(1, count=count)
    if workers is not None:
        require_count(0, workers=workers)
    if agents is not None:
        require_choice("agents", agents, AGENTS)
    if backend is not None:
        require_choice("backend", backend, ("local",), "(vectors no longer run on Ray)")
        warnings.warn("backend is deprecated, as 'local' is the only one: leave it out", DeprecationWarning, 2)
    if seed is not None:
        require_vector_seed(seed)
    if not (isinstance(environment, (str, Path)) or callable(environment)):
        raise InvalidValueError(f"environment must be a name, the path of a file or a function, got {environment!r}")
    if workers != 0 and os.name != "posix":
        raise InvalidValueError("worker processes need POSIX (Linux, macOS): choose workers=0")
    mode = _autoreset_mode(autoreset_mode)
    recipe = Recipe(environment, agents, options, _wrappers(wrap)).packed()
    workers = min(count, cores() if workers is None else workers)
    try:
        pool = WorkerPool(recipe, count, workers) if workers else CallingProcess(recipe, count)
    except UnknownNameError as error:
        if error.kind == "option" and error.name in options and not callable(environment):
            raise _unknown_option(error, agents) from error
        raise
    try:
        stepper = Stepper(pool, count, mode, seed)
        made = AGENTS[stepper.description.single]
        if agents not in (None, made):
            raise InvalidValueError(
                f"agents must be {made!r} or left out for what the environments are, got {agents!r}"
            )
        kind = SingleAgentVector if stepper.description.single else MultiAgentVector
        return kind(stepper, pool.end)
    except BaseException:
        pool.end()
        raise


def _unknown_option(error: UnknownNameError, agents: str | None) -> UnknownNameError:
    """Return the error with the vector's own arguments among what is accepted."""
    own = [name for name, each in signature(vector).parameters.items() if each.kind is each.KEYWORD_ONLY]
    where = error.where
    if error.name == "num_envs":
        where = "(the number of environments is `count`)"
    elif agents != "single" and error.name in signature(importlib.import_module("coopsim").single_env).parameters:
        where = 'without agents="single"'
    return UnknownNameError(error.kind, error.name, {*error.known, *own, "count"}, where)


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


@dataclass(frozen=True, slots=True)
class Recipe:
    """Plan of the environments of a vector.

    Attributes:
        environment: name or scenario file, or a function that makes one.
        agents: "all", "single" or None (which is "all"): decides how names are made.
        options: options of the environment.
        wrap: wrappers, the innermost first.
    """

    environment: str | Path | Callable[..., Any]
    agents: str | None
    options: Mapping[str, Any]
    wrap: tuple[Wrap, ...]

    def make(self) -> Any:
        """Make an environment: of PettingZoo's parallel API, or of gymnasium."""
        if callable(self.environment):
            env = self.environment(**self.options)
        else:
            coopsim = importlib.import_module("coopsim")
            make = coopsim.single_env if self.agents == "single" else coopsim.parallel_env
            env = make(self.environment, **self.options)
        for wrapper in self.wrap:
            env = wrapper(env)
        return env

    def packed(self) -> bytes:
        """Return the recipe as bytes for other processes, with what the caller's script defines and registers.

        Raises:
            InvalidValueError: a part cannot be sent.
        """
        try:
            packed: bytes = pickle.dumps((pack_registrations(), cloudpickle.dumps(self)))
        except Exception as error:  # pickling runs code of what is pickled
            raise InvalidValueError(f"environment, options and wrap must be such as can be pickled: {error}") from error
        return packed
