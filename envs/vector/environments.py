"""Environments of one worker: the orders that they obey, and the replies."""

from __future__ import annotations

import pickle
import traceback
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import gymnasium

from coopsim.errors import InvalidActionError, InvalidValueError, RecordingError, UnknownNameError
from coopsim.support.registrations import register_packed

REFUSALS = {
    "step": (InvalidActionError,),
    "reset": (InvalidValueError, UnknownNameError, RecordingError),
}
"""Errors, by call, after which an environment is as it was before."""


class Order(NamedTuple):
    """A call of the environment with index `env`: "step", "reset", "get", "set" or "close"."""

    env: int
    call: str
    arguments: tuple[Any, ...]


class Transition(NamedTuple):
    """The outcome of a step, or of the reset that takes the place of a step.

    In an environment of many agents, each of the first five is a dict by agent.

    Attributes:
        observation: observation after the step; with a reset in the same step, the new episode's.
        reward: 0 in a reset, as `terminated` and `truncated` are False.
        over: the episode is over, and no other has begun.
        final: last observation and info of an episode that ended in this step, where the next began in it too.
        lost: the next should have begun in it, but its reset failed: to be reported by the next call.
    """

    observation: Any
    reward: Any
    terminated: Any
    truncated: Any
    info: Any
    over: bool
    final: tuple[Any, Any] | None = None
    lost: Failure | None = None


def truncated(last: Any, report: str, *, single: bool, same_step: bool) -> Transition:
    """Return the transition of a lost environment: a truncation, with its last observation and the report in its info.

    Args:
        last: the observation; None: it has none.
        report: why it is lost.
        single: it has one agent.
        same_step: the end of an episode is told as `Transition.final`.
    """
    reward: Any = 0.0
    never: Any = False
    ended: Any = True
    info: dict[str, Any] = {"error": report}
    if not single:
        last = last or {}
        reward, never, ended = (dict.fromkeys(last, each) for each in (reward, never, ended))
        info = {agent: dict(info) for agent in last}
    return Transition(last, reward, never, ended, info, True, (last, dict(info)) if same_step else None)


class Value(NamedTuple):
    """The outcome of another call."""

    value: Any


class Failure(NamedTuple):
    """A call that ended in an error, or whose worker died.

    Attributes:
        report: the traceback, or the cause of the worker's death.
        error: the exception, if other processes can have it.
        refused: the environment is as it was before.
    """

    report: str
    error: Exception | None = None
    refused: bool = False

    @property
    def exception(self) -> Exception:
        """The error to raise, with the traceback as a note."""
        error = self.error or RuntimeError(self.report.rstrip().rpartition("\n")[2])
        error.add_note(f"Where it was raised:\n{self.report}")
        return error


Reply = Transition | Value | Failure


@dataclass(frozen=True, slots=True)
class Description:
    """Spaces and metadata, which all environments of a vector have in common.

    Attributes:
        single: they are gymnasium's, of one agent; otherwise PettingZoo's, of many.
        observation: space, or spaces by agent.
        action: space, or spaces by agent.
    """

    single: bool
    observation: Any
    action: Any
    metadata: dict[str, Any]
    render_mode: str | None


class EnvironmentGroup:
    """Environments that are called in one process, one after another.

    Each is made of a copy of the packed `Recipe`, so that nothing is shared; indices are places in the vector.
    """

    def __init__(self, recipe: bytes, indices: Sequence[int]) -> None:
        registrations, packed = pickle.loads(recipe)
        register_packed(registrations)
        self._envs = {index: pickle.loads(packed).make() for index in indices}

    def describe(self) -> Description:
        """Describe the first environment."""
        env = next(iter(self._envs.values()))
        if isinstance(env, gymnasium.Env):
            return Description(True, env.observation_space, env.action_space, dict(env.metadata), env.render_mode)
        if not callable(getattr(env, "observation_space", None)) or not hasattr(env, "possible_agents"):
            raise InvalidValueError(
                "a vector is made of environments of gymnasium (gymnasium.Env) or of PettingZoo's parallel API, "
                f"got a {type(env).__name__}"
            )
        names = list(env.possible_agents)
        return Description(
            False,
            {name: env.observation_space(name) for name in names},
            {name: env.action_space(name) for name in names},
            dict(getattr(env, "metadata", {})),
            getattr(env, "render_mode", None),
        )

    def do(self, order: Order) -> Reply:
        """Obey an order. What it raises is its reply, but for Ctrl-C."""
        env = self._envs[order.env]
        try:
            reply: Reply = _CALLS[order.call](env, *order.arguments)
        except KeyboardInterrupt:
            raise
        except BaseException as error:  # a user's environment may raise anything, and the others go on
            return failure(error, refused=isinstance(error, REFUSALS.get(order.call, ())))
        return reply


def failure(error: BaseException, *, refused: bool = False) -> Failure:
    """Return an error as a reply, with the error itself where it can be pickled."""
    report = "".join(traceback.format_exception(error))
    try:
        pickle.loads(pickle.dumps(error))
    except Exception:  # pickling runs code of what is pickled
        return Failure(report, None, refused)
    return Failure(report, error if isinstance(error, Exception) else None, refused)


def _reset(env: Any, seed: int, options: dict[str, Any] | None) -> Transition:
    observation, info = env.reset(seed=seed, options=options)
    if isinstance(env, gymnasium.Env):
        return Transition(observation, 0.0, False, False, info, False)
    agents = list(env.agents)
    never = dict.fromkeys(agents, False)
    return Transition(observation, dict.fromkeys(agents, 0.0), never, dict(never), info, not agents)


def _step(env: Any, action: Any, next_seed: int | None) -> Transition:
    """Step; where `next_seed` is given and the episode ends, begin the next one."""
    observation, reward, terminated, truncated, info = env.step(action)
    over = bool(terminated or truncated) if isinstance(env, gymnasium.Env) else not env.agents
    if not over or next_seed is None:
        return Transition(observation, reward, terminated, truncated, info, over)
    try:
        begun = _reset(env, next_seed, None)
    except KeyboardInterrupt:
        raise
    except BaseException as error:  # the episode has its proper end all the same
        ended = observation, info
        return Transition(observation, reward, terminated, truncated, {}, True, ended, failure(error))
    return Transition(begun.observation, reward, terminated, truncated, begun.info, begun.over, (observation, info))


def _get(env: Any, name: str, args: tuple[Any, ...], keywords: dict[str, Any]) -> Value:
    """Call a method or, without arguments, get an attribute."""
    found = env.get_wrapper_attr(name) if isinstance(env, gymnasium.Env) else getattr(env, name)
    return Value(found(*args, **keywords) if callable(found) else found)


def _set(env: Any, name: str, value: Any) -> Value:
    if isinstance(env, gymnasium.Env):
        env.set_wrapper_attr(name, value)
    else:
        setattr(env, name, value)
    return Value(None)


def _close(env: Any) -> Value:
    return Value(env.close())


_CALLS: dict[str, Any] = {"reset": _reset, "step": _step, "get": _get, "set": _set, "close": _close}
