"""Episodes of a vector: seeds, autoreset, and environments that are lost."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, NamedTuple, Self

import numpy as np
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray

from coopsim.envs.vector.environments import Description, Failure, Order, Reply, Transition, Value
from coopsim.envs.vector.workers import Pool, Round
from coopsim.errors import (
    EpisodeStateError,
    InvalidActionError,
    InvalidValueError,
    LostEnvironmentsError,
    UnknownNameError,
)
from coopsim.support.rng import fresh_seed, require_seed, stream

MASK = "reset_mask"


class Episodes(NamedTuple):
    """Episodes of one environment; their seeds do not depend on workers.

    Attributes:
        env: index of the environment.
        seed: seed that `reset` was given; negative before the first.
        exact: `seed` is the first episode's own, as it was given for this environment alone.
        number: number of the next episode.
        observation: last observation; None before the first.
        over: none is running.
    """

    env: int
    seed: int
    exact: bool = False
    number: int = 0
    observation: Any = None
    over: bool = True

    @property
    def next_seed(self) -> int:
        """Seed of the next episode: drawn by seed, index and number."""
        if self.exact and self.number == 0:
            return self.seed
        return int(stream(self.seed, "vector", str(self.env), str(self.number)).integers(2**63))

    def after(self, transition: Transition, *, began: bool) -> Self:
        """Return the episodes after a step or a reset, which began another one or did not."""
        # The observation is not copied: at each step that would take longer than sending it does.
        return self._replace(number=self.number + began, observation=transition.observation, over=transition.over)


class Stepper:
    """Steps and resets all environments, and keeps what a vector must remember of each.

    After an interrupted or refused step the environments that have stepped keep their transitions for the next `step`,
    which passes over their actions; so no transition is lost, and none is made twice.
    """

    def __init__(self, pool: Pool, count: int, mode: AutoresetMode, seed: int | None) -> None:
        self.count, self.mode = count, mode
        self.description: Description = pool.description
        self._pool, self._seed = pool, seed
        self._episodes = [Episodes(index, -1) for index in range(count)]
        self._kept: dict[int, Transition | Failure] = {}
        self._begun = self._closed = False

    def reset(
        self, seed: object, options: Mapping[str, Any] | None
    ) -> tuple[list[Any], dict[int, Any], dict[int, str]]:
        """Begin episodes; return observations of all environments, infos of those that began, and reports of lost ones.

        The observation of a lost one is its last, or None.

        Args:
            seed: one integer >= 0 for all, one integer or None for each, or None to go on with the next episodes.
            options: options of the environments' `reset`; `reset_mask` (count,) chooses the environments, None is all.

        Raises:
            InvalidValueError: a seed or an option is not accepted. Where environments refuse an option, these are as
                they were; so are all where the vector does.
            UnknownNameError: an option is nearly `reset_mask`.
            EpisodeStateError: the first reset is not of all environments.
        """
        self._require_open()
        given = _options(options)
        chosen = [int(index) for index in np.flatnonzero(self._mask(given.pop(MASK, None)))]
        planned = self._planned(seed)
        if not self._begun and len(chosen) < self.count:
            raise EpisodeStateError(f"the first reset must be of all environments, without {MASK}")
        self._drain()
        orders = [Order(index, "reset", (planned[index].next_seed, given or None)) for index in chosen]
        round_ = self._pool.run(orders)
        replies = round_.replies
        refused = {index: reply for index, reply in replies.items() if isinstance(reply, Failure) and reply.refused}
        episodes = list(self._episodes)
        for index in chosen:
            reply = replies[index]
            if isinstance(reply, Transition):
                episodes[index] = planned[index].after(reply, began=True)
            elif index not in refused or not self._begun:
                episodes[index] = planned[index]._replace(observation=episodes[index].observation, over=True)
        kept = {index: reply for index, reply in self._kept.items() if index not in chosen}
        self._commit(_lose(episodes, replies), kept)
        self._begun = self._begun or len(refused) < len(replies)
        for failure in refused.values():
            raise failure.exception
        infos = {index: reply.info for index, reply in replies.items() if isinstance(reply, Transition)}
        return [each.observation for each in self._episodes], infos, _reports(replies)

    def step(self, actions: Sequence[Any]) -> tuple[list[Transition], dict[int, str]]:
        """Step all environments; return their transitions, and reports of those that were lost.

        The transition of a lost one is a truncation, with its last observation, and the report in its info.

        Raises:
            EpisodeStateError: before `reset`, or an episode is over and autoreset is disabled.
            InvalidActionError: an environment refused its action.
        """
        self._require_open()
        if not self._begun:
            raise EpisodeStateError("there are no episodes yet: call reset first")
        self._drain()
        self._require_running()
        missing = [each for each in self._episodes if each.env not in self._kept]
        self._keep(self._pool.run([self._order(each, actions[each.env]) for each in missing]))
        refused = {index: reply for index, reply in self._kept.items() if isinstance(reply, Failure) and reply.refused}
        if refused:
            self._kept = {index: reply for index, reply in self._kept.items() if index not in refused}
            raise InvalidActionError(_refusal(refused, self.count))
        replies = self._kept
        lost: dict[int, Transition | Failure] = {}
        episodes, transitions = list(self._episodes), []
        for each in self._episodes:
            reply = replies[each.env]
            if isinstance(reply, Failure):
                transitions.append(self._truncated(each, reply.report))
                continue
            began = each.over or (reply.final is not None and reply.lost is None)
            episodes[each.env] = each.after(reply, began=began)
            transitions.append(reply)
            if reply.lost is not None:
                lost[each.env] = reply.lost
        self._commit(_lose(episodes, replies), lost)
        return transitions, _reports(replies)

    def call(self, call: str, arguments: Sequence[tuple[Any, ...]]) -> tuple[Any, ...]:
        """Call "get" or "set" of every environment with its arguments; return the values.

        Raises:
            Exception: an error of an environment.
            LostEnvironmentsError: a worker died.
        """
        self._require_open()
        self._drain()
        round_ = self._pool.run([Order(index, call, each) for index, each in enumerate(arguments)])
        self._keep(round_)
        if round_.dead:
            dead = {index: round_.replies[index] for index in round_.dead}
            self._episodes = _lose(list(self._episodes), dead)
            raise LostEnvironmentsError(_reports(dead))
        values = []
        for index in range(self.count):
            reply = round_.replies[index]
            if isinstance(reply, Failure):
                raise reply.exception
            values.append(reply.value if isinstance(reply, Value) else None)
        return tuple(values)

    def close(self) -> None:
        """Close the environments and end the workers; may be called again."""
        if self._closed:
            return
        self._closed = True
        try:
            if not self._pool.busy:
                self._pool.run([Order(index, "close", ()) for index in range(self.count)], replace=False)
        finally:
            self._pool.end()

    def _commit(self, episodes: list[Episodes], kept: dict[int, Transition | Failure]) -> None:
        """Note the outcome of a call, in one line that Ctrl-C cannot divide."""
        self._episodes, self._kept = episodes, kept
        self._pool.forget()

    def _order(self, episodes: Episodes, action: Any) -> Order:
        if episodes.over:
            return Order(episodes.env, "reset", (episodes.next_seed, None))
        next_seed = episodes.next_seed if self.mode is AutoresetMode.SAME_STEP else None
        return Order(episodes.env, "step", (action, next_seed))

    def _drain(self) -> None:
        """Take the replies of a call that was interrupted."""
        round_ = self._pool.finish()
        if round_ is not None:
            begun = [index for index, order in round_.orders.items() if order.call == "reset"]
            # These are in episodes that nobody has seen the beginning of.
            unseen = [each._replace(over=True) if each.env in begun else each for each in self._episodes]
            self._episodes = unseen
            self._keep(round_, resets=False)

    def _keep(self, round_: Round, *, resets: bool = True) -> None:
        """Keep transitions for the next step, and deaths."""
        calls = {index: order.call for index, order in round_.orders.items()}
        accepted = ("step", "reset") if resets else ("step",)
        kept = {
            index: reply
            for index, reply in round_.replies.items()
            if not isinstance(reply, Value) and (index in round_.dead or calls.get(index) in accepted)
        }
        self._kept = self._kept | kept
        self._pool.forget()

    def _truncated(self, episodes: Episodes, report: str) -> Transition:
        last, same_step = episodes.observation, self.mode is AutoresetMode.SAME_STEP
        if self.description.single:
            info: dict[str, Any] = {"error": report}
            return Transition(last, 0.0, False, True, info, True, (last, dict(info)) if same_step else None)
        agents = list(last or ())
        infos = {agent: {"error": report} for agent in agents}
        return Transition(
            last or {},
            dict.fromkeys(agents, 0.0),
            dict.fromkeys(agents, False),
            dict.fromkeys(agents, True),
            infos,
            True,
            (last or {}, infos) if same_step else None,
        )

    def _planned(self, seed: object) -> list[Episodes]:
        """Return the episodes that a reset with `seed` begins."""
        if seed is None and self._begun:
            return self._episodes
        seed = self._seed if seed is None else seed
        if isinstance(seed, (list, tuple, np.ndarray)):
            return self._planned_each(seed)
        base = fresh_seed() if seed is None else seed
        require_vector_seed(base)
        return [Episodes(index, int(base)) for index in range(self.count)]  # type: ignore[call-overload]

    def _planned_each(self, seeds: Sequence[Any] | NDArray[Any]) -> list[Episodes]:
        if len(seeds) != self.count:
            raise InvalidValueError(f"seed must have one entry for each of {self.count} environments, got {len(seeds)}")
        planned = list(self._planned(None))
        for index, seed in enumerate(seeds):
            if seed is not None:
                require_vector_seed(seed)
                planned[index] = Episodes(index, int(seed), exact=True)
        return planned

    def _mask(self, mask: object) -> NDArray[np.bool_]:
        if mask is None:
            return np.ones(self.count, bool)
        fits = isinstance(mask, np.ndarray) and mask.dtype == np.bool_ and mask.shape == (self.count,)
        if not fits or not mask.any():  # type: ignore[attr-defined]
            raise InvalidValueError(
                f"{MASK} must be an array ({self.count},) of bool with at least one True, got {mask!r}"
            )
        return np.asarray(mask)

    def _require_open(self) -> None:
        if self._closed:
            raise EpisodeStateError("the vector is closed")

    def _require_running(self) -> None:
        over = [each.env for each in self._episodes if each.over]
        if over and self.mode is AutoresetMode.DISABLED:
            raise EpisodeStateError(
                f"the episodes of environments {_listed(over)} are over: reset them with "
                f'options={{"{MASK}": mask}}, or use another autoreset_mode'
            )


def require_vector_seed(seed: object) -> None:
    """Raise `InvalidValueError` unless `seed` is an integer >= 0 that all kinds of environments can take."""
    require_seed(seed)
    if int(seed) >= 2**63:  # type: ignore[call-overload]
        raise InvalidValueError(f"seed must be < 2**63 in a vector, got {seed}")


def _options(options: object) -> dict[str, Any]:
    """Return options of `reset` as a dict of their own; refuse what is nearly the mask's name."""
    if options is not None and not isinstance(options, Mapping):
        raise InvalidValueError(f"options of reset must be a mapping, got {options!r}")
    given = dict(options or {})
    for name in given:
        if name != MASK and difflib.get_close_matches(str(name), [MASK], cutoff=0.75):
            raise UnknownNameError("option of reset", name, [MASK])
    return given


def _reports(replies: Mapping[int, Reply]) -> dict[int, str]:
    """Return the reports of environments that were lost, by index."""
    return {
        index: reply.report
        for index, reply in sorted(replies.items())
        if isinstance(reply, Failure) and not reply.refused
    }


def _lose(episodes: list[Episodes], replies: Mapping[int, Reply]) -> list[Episodes]:
    """Return the episodes, of which those of lost environments are over."""
    lost = _reports(replies)
    return [each._replace(over=True) if each.env in lost else each for each in episodes]


def _refusal(refused: Mapping[int, Failure], count: int) -> str:
    what = "; ".join(f"environment {index}: {refused[index].error or refused[index].report}" for index in refused)
    if len(refused) == count:
        return f"{what}. No environment has stepped"
    return (
        f"{what}. The other environments have stepped: step again with other actions for environments "
        f"{_listed(refused)}, and those of the others are passed over"
    )


def _listed(indices: Iterable[int]) -> str:
    return ", ".join(map(str, indices))
