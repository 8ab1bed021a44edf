"""Our side of a process that runs one agent's policy: orders, answers, time limits and errors."""

from __future__ import annotations

import pickle
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from coopsim.bench.isolated.forks import GuestProcess
from coopsim.bench.isolated.parcels import unpack_parcel
from coopsim.catalog import PolicySpec
from coopsim.comms.codecs.codec import make_codec
from coopsim.comms.envelope import decode_message
from coopsim.comms.uplinks.uplink import ContentUplink
from coopsim.errors import CoopsimError, InvalidValueError, IsolatedPolicyError
from coopsim.types import Message, Observation

BEGIN_S = 600.0
"""Time limit of what is done once: importing, making the policy, beginning an episode, its first frame."""

_GRACE_S = 5.0


class RemoteGuest:
    """A policy in a process of its own.

    Attributes:
        confinement: the parts of its confinement, and whether they hold (`confine`).
        made: description of the policy: `needs`, `method`, and whether it is `guarded`.
        has_begun: the first frame of the episode is over, so that from now on the time limit is that of a frame.

    Args:
        spec: the policy.
        limit_s: time limit of a frame.
        readable: files and folders that it may read.
        number: number of the process.

    Raises:
        IsolatedPolicyError: the policy cannot be made there, see `ask`.
    """

    def __init__(self, spec: PolicySpec, limit_s: float, readable: Sequence[str], number: int) -> None:
        self._name, self._limit_s, self.has_begun = spec.text, limit_s, False
        self.process = GuestProcess(readable, number)
        try:
            self.confinement: dict[str, bool] = self.ask("confinement")
            self.made: Mapping[str, Any] = self.ask("make", spec)
        except BaseException:
            self.process.end()
            raise

    def ask(self, order: str, *arguments: Any) -> Any:
        """Give an order, and wait for its answer.

        Raises:
            IsolatedPolicyError: the policy raised an error, took longer, answered nonsense, or its process died.
        """
        self.give(order, *arguments)
        return self.answer()

    def give(self, order: str, *arguments: Any) -> None:
        """Give an order, and do not wait."""
        try:
            self.process.pipe.send(pickle.dumps((order, arguments), protocol=5), self._limit())
        except TimeoutError:
            raise self._late() from None
        except BrokenPipeError:
            raise self._gone() from None

    def answer(self) -> Any:
        """Wait for the answer to an order."""
        try:
            answer = unpack_parcel(self.process.pipe.receive(self._limit()))
        except TimeoutError:
            raise self._late() from None
        except EOFError:
            raise self._gone() from None
        except ValueError as error:
            raise self.nonsense(str(error)) from error
        if not isinstance(answer, Mapping) or not answer.keys() & {"answer", "error"}:
            raise self.nonsense("neither an answer nor an error")
        if "error" in answer:
            raise self.error(f"raised an error in its own process: {str(answer['error']).rstrip()}")
        return answer["answer"]

    def nonsense(self, why: str) -> IsolatedPolicyError:
        """Return the error that the answer makes no sense."""
        return self.error(f"answered nonsense: {why}")

    def error(self, what: str) -> IsolatedPolicyError:
        """Return an error that names the policy."""
        return IsolatedPolicyError(f"policy {self._name!r} {what}")

    def _limit(self) -> float:
        return self._limit_s if self.has_begun else max(self._limit_s, BEGIN_S)

    def _late(self) -> IsolatedPolicyError:
        return self.error(f"has not answered within {self._limit():g} s")

    def _gone(self) -> IsolatedPolicyError:
        return self.error(f"is gone: its process ended ({self.process.end(_GRACE_S)})")


class RemoteUplink(ContentUplink[Any]):
    """An uplink of one agent in that agent's process. Its messages come as bytes on the air."""

    shows_content = False

    def __init__(self, guest: RemoteGuest, content: str, codec: str | None, *, hears: bool) -> None:
        self.content = content  # type: ignore[misc]  # of the class elsewhere
        self._guest, self._hears, self.codec_name = guest, hears, ""
        if codec is not None:
            self.codec_name, self.codec = make_codec(codec, content)

    def content_of(self, sender: str, observation: Observation) -> Any:
        raise InvalidValueError("content is made in the policy's own process: ask for messages")

    def prepare_budget(self) -> None:
        raise InvalidValueError(
            "budget_bytes must be None for policies in a process of their own, which make the bytes"
        )

    def messages(self, observations: Mapping[str, Observation]) -> dict[str, Message]:
        made = self._guest.ask("messages", dict(observations))
        try:
            wires: dict[str, np.ndarray[Any, Any]] = {name: made[name] for name in observations if name in made}
            return {name: decode_message(wire.tobytes()) for name, wire in wires.items()}
        except (AttributeError, TypeError, CoopsimError) as error:
            raise InvalidValueError(f"the policy's own process answered no messages: {error}") from error

    def hear(self, receiver: str, observation: Observation) -> None:
        if self._hears:
            self._guest.ask("hear", receiver, observation)
