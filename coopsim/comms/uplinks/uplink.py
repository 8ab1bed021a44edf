"""The uplink interface: the messages that agents make of their observations.

An environment's option `uplink` names one, or brings one as an object: a factory, or a policy, whose `make_uplink` is
the factory. So a policy can broadcast its own results, and share the computation with its `track`.
"""

from __future__ import annotations

import inspect
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from typing import Any, ClassVar, Generic, TypeVar

import numpy as np

from coopsim.comms.codecs.codec import CODECS, Codec, make_codec, require_codec
from coopsim.config.spec import instantiate, parse_spec
from coopsim.errors import InvalidValueError, UnknownNameError
from coopsim.support.registry import Registry
from coopsim.types import AgentSpec, Message, Observation

T = TypeVar("T")


class Uplink(ABC):
    """Messages of one or more agents over one episode; asked once per frame, in order, and may keep state per agent.

    Attributes:
        content: the kind of content of its messages: "none", "detections", "tracks", "points", "features", "queries",
            or a custom one.
        beside: codecs of the messages about its senders' own motion that the environment sends beside: "mcm", "denm".
    """

    content: ClassVar[str]
    beside: tuple[str, ...] = ()

    def begin(self, spec: AgentSpec, rng: np.random.Generator) -> None:
        """Make the state of one agent; called once per agent when an episode begins, before its first message.

        Args:
            spec: the agent.
            rng: the agent's own random stream, for uplinks that draw random numbers.
        """

    @abstractmethod
    def message(self, sender: str, observation: Observation) -> Message | None:
        """Return the message of `sender` for its latest observation, whose inbox is empty; None to stay silent."""

    def messages(self, observations: Mapping[str, Observation]) -> dict[str, Message]:
        """Return the messages of one frame by sender, without those that stay silent.

        By default `message` is asked for each sender. Override it to compute all senders in one batch.

        Args:
            observations: observations by name, for the agents that this object serves.
        """
        made = {sender: self.message(sender, observation) for sender, observation in observations.items()}
        return {sender: message for sender, message in made.items() if message is not None}

    def hear(self, receiver: str, observation: Observation) -> None:
        """Take notice of the frame's inbox of `receiver`; called after the messages of the frame."""


class ContentUplink(Uplink, Generic[T]):
    """An uplink that makes content for a codec to encode: the base of all uplinks in coopsim.

    Its messages can be kept within a budget of bytes, if the codec can leave something out.

    Attributes:
        codec: the codec.
        codec_name: its registered name, which messages carry.
        shows_content: its content can be seen before it is encoded; False where it is made in another process.

    Args:
        codec: a codec for this content, or the spec of one, as "sparse_features(most_cells=500)".

    Raises:
        UnknownNameError: there is no such codec for this content, or the class of the codec is not registered.
    """

    shows_content: ClassVar[bool] = True

    def __init__(self, codec: str | Codec[T]) -> None:
        self.codec: Codec[T]
        if isinstance(codec, Codec):
            self.codec_name, self.codec = CODECS.name_of(type(codec)), codec
            require_codec(self.codec_name, self.content)
        else:
            self.codec_name, self.codec = make_codec(codec, self.content)

    @abstractmethod
    def content_of(self, sender: str, observation: Observation) -> T | None:
        """Return the content of the message of `sender`, or None to stay silent."""

    def contents(self, observations: Mapping[str, Observation]) -> dict[str, T]:
        """Return the contents of one frame by sender. Override it to compute all senders in one batch."""
        made = {sender: self.content_of(sender, observation) for sender, observation in observations.items()}
        return {sender: content for sender, content in made.items() if content is not None}

    def prepare_budget(self) -> None:
        """Get ready to send within a budget of bytes, before the first message.

        Override it in an uplink that then takes another codec, which can leave something out.
        """

    def message(self, sender: str, observation: Observation) -> Message | None:
        return self.messages({sender: observation}).get(sender)

    def messages(self, observations: Mapping[str, Observation]) -> dict[str, Message]:
        return {
            sender: self.message_with(sender, observations[sender], self.encode_content(sender, content))
            for sender, content in self.contents(observations).items()
        }

    def encode_content(self, sender: str, content: T) -> bytes:
        """Return the payload of the content of `sender`; raise unless the codec can carry it."""
        try:
            return self.codec.encode(content)
        except (AttributeError, TypeError) as error:
            raise InvalidValueError(
                f"{type(self).__name__} must make content that codec {self.codec_name!r} encodes, got "
                f"{type(content).__name__} for {sender}: {error}"
            ) from error

    def message_with(self, sender: str, observation: Observation, payload: bytes) -> Message:
        """Return the message of `sender` with this payload."""
        return Message(sender, observation.time_ns, observation.pose, payload, self.codec_name)


class Silence(Uplink):
    """Uplink that sends nothing."""

    content = "none"

    def message(self, sender: str, observation: Observation) -> Message | None:
        return None


UPLINKS: Registry[type[Uplink]] = Registry("uplink", home="coopsim.comms.uplinks", group="coopsim.uplinks")
"""Uplink classes. Installed packages add theirs through the entry-point group `coopsim.uplinks`."""

UPLINKS.register("none")(Silence)

MakeUplink = Callable[[AgentSpec, np.random.Generator], Uplink]
"""A factory of uplinks, called for each agent when an episode begins; it may return the same object for several agents.
The spec has the option `codec`, but not yet an uplink."""


def named_uplink(spec: str, codec: str | None = None) -> Uplink:
    """Make an uplink by its spec, such as `points(keep=0.5)`, with the spec of its codec; None: its own choice.

    Raises:
        UnknownNameError: there is no such uplink, parameter, or codec for its content.
        InvalidValueError: the uplink cannot be made by its name alone, or has no choice of codecs.
    """
    if not isinstance(spec, str):
        raise UnknownNameError("uplink", spec, UPLINKS.names())
    name, parameters = parse_spec("uplink", spec)
    uplink = UPLINKS.get(name)
    signature = inspect.signature(uplink).parameters
    if codec is not None:
        if "codec" not in signature:
            raise InvalidValueError(
                f"codec must be None for uplink {name!r}, which has no choice of codecs, got {codec!r}"
            )
        parameters["codec"] = codec
    missing = [
        each.name
        for each in signature.values()
        if each.default is each.empty and each.kind not in (each.VAR_POSITIONAL, each.VAR_KEYWORD)
    ]
    if wanting := [each for each in missing if each not in parameters]:
        raise InvalidValueError(
            f"uplink {name!r} needs {', '.join(wanting)}, which a name cannot give: pass a factory, as "
            f"uplink=lambda spec, rng: {uplink.__name__}(...), or a policy with a make_uplink of its own"
        )
    return instantiate("uplink", name, uplink, parameters)


def uplink_factory(option: Any, codec: str | None = None) -> MakeUplink:
    """Return the factory for a value of the option `uplink`: a spec, a factory, or a policy.

    Raises:
        InvalidValueError: the value is none of these, or the spec is refused (see `named_uplink`).
    """
    if isinstance(option, str):
        named_uplink(option, codec)  # refused now, not when the first episode begins
        return lambda spec, rng: named_uplink(option, codec)
    if isinstance(option, type):
        raise InvalidValueError(
            f"uplink must be an object, got the class {option.__name__}: write {option.__name__}() for a policy, or "
            f"lambda spec, rng: {option.__name__}(...) for an uplink"
        )
    make = getattr(option, "make_uplink", option)
    if isinstance(option, Uplink) or not callable(make):
        hint = ": write lambda spec, rng: uplink" if isinstance(option, Uplink) else ""
        raise InvalidValueError(
            f"uplink must be one of {', '.join(UPLINKS.names())}, a factory or a policy, got {option!r}{hint}"
        )
    factory: MakeUplink = make
    return factory
