"""Episodes of a vector: seeds, autoreset, and environments that are lost."""

from __future__ import annotations

import difflib
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray

from coopsim.envs.parallel import fresh_seed
from coopsim.envs.vector.courses import Course
from coopsim.envs.vector.crew import DIED, Crew
from coopsim.envs.vector.group import Description, Failure, Order, Reply, Transition, Value
from coopsim.errors import (
    EpisodeStateError,
    InvalidActionError,
    InvalidValueError,
    LostEnvironmentsError,
    UnknownNameError,
)
from coopsim.support.rng import require_seed

MASK = "reset_mask"


class Stepper:
    """Steps and resets all environments, and keeps what a vector must remember of each.

    After an interrupted or refused step the environments that have stepped keep their transitions for the next `step`,
    which passes over their actions; so no transition is lost, and none is made twice.

    Args:
        crew: has the environments.
        count: their number.
        mode: when a new episode begins after one that ended.
        seed: of a `reset` without one; None: a fresh one.
    """

    def __init__(self, crew: Crew, count: int, mode: AutoresetMode, seed: int | None) -> None:
        self.count, self.mode = count, mode
        self.description: Description = crew.description
        self._crew, self._seed = crew, seed
        self._courses: list[Course] | None = None  # none before the first reset
        self._observations: list[Any] = [None] * count
        self._over = [True] * count
        self._kept: dict[int, Transition | Failure] = {}
        self._closed = False

    def reset(
        self, seed: object, options: Mapping[str, Any] | None
    ) -> tuple[list[Any], dict[int, Any], dict[int, str]]:
        """Begin episodes; return observations of all environments, infos of those that began, and reports of lost ones.

        The observation of a lost one is its last, or None.

        Args:
            seed: one integer >= 0 for all, one integer or None for each, or None to go on with the next episodes.
            options: of the environments' `reset`; `reset_mask` (count,) chooses the environments, None is all.

        Raises:
            InvalidValueError: a seed or an option is not accepted. Where environments refuse an option, these are as
                they were; so are all where the vector does.
            UnknownNameError: an option is nearly `reset_mask`.
            EpisodeStateError: the first reset is not of all environments.
        """
        with self._crew.hold:
            return self._reset(seed, options)

    def _reset(
        self, seed: object, options: Mapping[str, Any] | None
    ) -> tuple[list[Any], dict[int, Any], dict[int, str]]:
        self._require_open()
        given = _options(options)
        chosen = [int(index) for index in np.flatnonzero(self._mask(given.pop(MASK, None)))]
        courses = self._planned(seed)
        if self._courses is None and len(chosen) < self.count:
            raise EpisodeStateError(f"the first reset must be of all environments, without {MASK}")
        self._drain()
        for index in chosen:
            self._kept.pop(index, None)
        before = list(self._over)
        for index in chosen:
            self._over[index] = True  # until it has begun, also if Ctrl-C comes between
        self._crew.give([Order(index, "reset", (courses[index].next_seed, given or None)) for index in chosen])
        replies = {index: reply for index, _, reply in self._crew.replies()}
        refused = {index: reply for index, reply in replies.items() if isinstance(reply, Failure) and reply.refused}
        for index in refused:
            self._over[index] = before[index]
        if len(refused) < len(replies):
            self._begin({index: courses[index] for index in chosen if index not in refused}, courses, replies)
        for failure in refused.values():
            raise failure.exception
        lost = self._lost(replies)
        infos = {index: reply.info for index, reply in replies.items() if isinstance(reply, Transition)}
        return list(self._observations), infos, lost

    def step(self, actions: Sequence[Any]) -> tuple[list[Transition], dict[int, str]]:
        """Step all environments; return their transitions, and reports of those that were lost.

        The transition of a lost one is a truncation, with its last observation, and the report in its info.

        Raises:
            EpisodeStateError: before `reset`, or an episode is over and autoreset is disabled.
            InvalidActionError: an environment refused its action.
        """
        with self._crew.hold:
            return self._step(actions)

    def _step(self, actions: Sequence[Any]) -> tuple[list[Transition], dict[int, str]]:
        self._require_open()
        courses = self._courses
        if courses is None:
            raise EpisodeStateError("there are no episodes yet: call reset first")
        self._require_running()
        self._drain()
        missing = [index for index in range(self.count) if index not in self._kept]
        self._crew.give([self._order(courses[index], actions[index]) for index in missing])
        for index, _, reply in self._crew.replies():
            self._keep(index, reply)
        self._crew.hold.wait()  # Ctrl-C that came by now, while all is kept
        refused = {index: reply for index, reply in self._kept.items() if isinstance(reply, Failure) and reply.refused}
        if refused:
            for index in refused:
                del self._kept[index]
            raise InvalidActionError(_refusal(refused, self.count))
        replies, self._kept = self._kept, {}
        lost = self._lost(replies)
        return [self._transition(index, replies[index]) for index in range(self.count)], lost

    def call(self, call: str, arguments: Sequence[tuple[Any, ...]]) -> tuple[Any, ...]:
        """Call "get" or "set" of every environment with its arguments; return the values.

        Raises:
            Exception: what an environment raised.
            LostEnvironmentsError: a worker died.
        """
        with self._crew.hold:
            return self._call(call, arguments)

    def _call(self, call: str, arguments: Sequence[tuple[Any, ...]]) -> tuple[Any, ...]:
        self._require_open()
        self._drain()
        self._crew.give([Order(index, call, each) for index, each in enumerate(arguments)])
        values: dict[int, Any] = {}
        dead: dict[int, Reply] = {}
        failures: list[Failure] = []
        for index, name, reply in self._crew.replies():
            if name == DIED:
                dead[index] = reply
                self._keep(index, reply)
            elif isinstance(reply, Failure):
                failures.append(reply)
            else:
                values[index] = reply.value if isinstance(reply, Value) else None
        if dead:
            raise LostEnvironmentsError(self._lost(dead))
        for failure in failures:
            raise failure.exception
        return tuple(values[index] for index in range(self.count))

    def close(self) -> None:
        """Close the environments and end the workers; may be called again."""
        if self._closed:
            return
        self._closed = True
        try:
            if not self._crew.busy:
                with self._crew.hold:
                    self._crew.give([Order(index, "close", ()) for index in range(self.count)], replace=False)
                    for _ in self._crew.replies():
                        continue
        finally:
            self._crew.end()

    def _begin(self, begun: Mapping[int, Course], planned: list[Course], replies: Mapping[int, Reply]) -> None:
        """Note the replies of environments that were reset, and the courses that they have begun."""
        self._courses = self._courses or planned
        for index, course in begun.items():
            reply = replies[index]
            self._courses[index] = course
            if isinstance(reply, Transition):
                self._note(index, course.advanced, reply)

    def _order(self, course: Course, action: Any) -> Order:
        if self._over[course.env]:
            return Order(course.env, "reset", (course.next_seed, None))
        next_seed = course.next_seed if self.mode is AutoresetMode.SAME_STEP else None
        return Order(course.env, "step", (action, next_seed))

    def _keep(self, index: int, reply: Reply) -> None:
        if not isinstance(reply, Value):
            self._kept[index] = reply

    def _drain(self) -> None:
        """Take the replies of a call that was interrupted; those of steps are kept."""
        for index, call, reply in self._crew.replies():
            if call in ("step", DIED):
                self._keep(index, reply)
            elif call == "reset":  # it is in an episode that nobody has seen the beginning of
                self._over[index] = True

    def _note(self, index: int, course: Course, transition: Transition) -> None:
        assert self._courses is not None
        self._courses[index] = course
        # Not copied: at each step that would take longer than sending large observations does.
        self._observations[index], self._over[index] = transition.observation, transition.over

    def _transition(self, index: int, reply: Transition | Failure) -> Transition:
        """Note a reply, and return it as a transition."""
        assert self._courses is not None
        course = self._courses[index]
        if isinstance(reply, Failure):
            return self._truncated(index, reply.report)
        began = self._over[index] or (reply.final is not None and reply.lost is None)
        self._note(index, course.advanced if began else course, reply)
        if reply.lost is not None:
            self._kept[index] = reply.lost
        return reply

    def _truncated(self, index: int, report: str) -> Transition:
        last, same_step = self._observations[index], self.mode is AutoresetMode.SAME_STEP
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

    def _lost(self, replies: Mapping[int, Reply]) -> dict[int, str]:
        """Return the reports of environments that were lost, and note that their episodes are over."""
        lost = {
            index: reply.report
            for index, reply in sorted(replies.items())
            if isinstance(reply, Failure) and not reply.refused
        }
        for index in lost:
            self._over[index] = True
        return lost

    def _planned(self, seed: object) -> list[Course]:
        if seed is None and self._courses is not None:
            return list(self._courses)
        seed = self._seed if seed is None else seed
        if isinstance(seed, (list, tuple, np.ndarray)):
            return self._planned_each(seed)
        base = fresh_seed() if seed is None else seed
        require_vector_seed(base)
        return [Course(index, int(base)) for index in range(self.count)]  # type: ignore[call-overload]

    def _planned_each(self, seeds: Sequence[Any] | NDArray[Any]) -> list[Course]:
        if len(seeds) != self.count:
            raise InvalidValueError(f"seed must have one entry for each of {self.count} environments, got {len(seeds)}")
        courses = self._planned(None)
        for index, seed in enumerate(seeds):
            if seed is not None:
                require_vector_seed(seed)
                courses[index] = Course(index, int(seed), exact=True)
        return courses

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
        over = [index for index, over in enumerate(self._over) if over]
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


def _refusal(refused: Mapping[int, Failure], count: int) -> str:
    what = "; ".join(f"environment {index}: {refused[index].error or refused[index].report}" for index in refused)
    if len(refused) == count:
        return f"{what}. No environment has stepped"
    return (
        f"{what}. The other environments have stepped: step again with other actions for environments "
        f"{_listed(refused)}, and those of the others are passed over"
    )


def _listed(indices: Any) -> str:
    return ", ".join(map(str, indices))
