"""Episodes of a vector: seeds, autoreset, and environments that are lost."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from gymnasium.vector import AutoresetMode

from coopsim.envs.vector.environments import Description, Failure, Order, Reply, Transition, Value, truncated
from coopsim.envs.vector.episodes import MASK, Episodes, first_episodes, plan_episodes, read_options
from coopsim.envs.vector.pools import Pool, Round
from coopsim.errors import EpisodeStateError, InvalidActionError, LostEnvironmentsError


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
        chosen, given = read_options(options, self.count)
        planned = self._planned(seed)
        if not self._begun and len(chosen) < self.count:
            raise EpisodeStateError(f"the first reset must be of all environments, without {MASK}")
        self._drain()
        orders = [Order(index, "reset", (planned[index].next_seed, given or None)) for index in chosen]
        round_ = self._pool.run(orders)
        replies = round_.replies
        refused = _refused(replies)
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
        refused = _refused(self._kept)
        if refused:
            self._kept = {index: reply for index, reply in self._kept.items() if index not in refused}
            raise InvalidActionError(_refusal(refused, self.count))
        replies = self._kept
        lost: dict[int, Transition | Failure] = {}
        episodes, transitions = list(self._episodes), []
        for each in self._episodes:
            reply = replies[each.env]
            if isinstance(reply, Failure):
                single, same_step = self.description.single, self.mode is AutoresetMode.SAME_STEP
                transitions.append(truncated(each.observation, reply.report, single=single, same_step=same_step))
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
        replies = [round_.replies[index] for index in range(self.count)]
        for reply in replies:
            if isinstance(reply, Failure):
                raise reply.exception
        return tuple(reply.value for reply in replies if isinstance(reply, Value))

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
            begun = {index for index, order in round_.orders.items() if order.call == "reset"}
            # These are in episodes that nobody has seen the beginning of.
            self._episodes = [each._replace(over=True) if each.env in begun else each for each in self._episodes]
            self._keep(round_, resets=False)

    def _keep(self, round_: Round, *, resets: bool = True) -> None:
        """Keep transitions for the next step, and deaths."""
        accepted = ("step", "reset") if resets else ("step",)
        kept = {
            index: reply
            for index, reply in round_.replies.items()  # the dead are more than those with an order
            if not isinstance(reply, Value) and (index in round_.dead or round_.orders[index].call in accepted)
        }
        self._kept = self._kept | kept
        self._pool.forget()

    def _planned(self, seed: object) -> list[Episodes]:
        """Return the episodes that a reset with `seed` begins."""
        following = self._episodes if self._begun else first_episodes(self._seed, self.count)
        return plan_episodes(seed, following)

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


def _refused(replies: Mapping[int, Reply]) -> dict[int, Failure]:
    """Return the replies of environments that are as they were, by index."""
    return {index: reply for index, reply in replies.items() if isinstance(reply, Failure) and reply.refused}


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
