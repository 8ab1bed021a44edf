"""The conformance checks of an uplink and of a codec."""

from __future__ import annotations

import contextlib
import random
import tracemalloc
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import fields, is_dataclass, replace
from typing import Any

import numpy as np

from coopsim.comms.codecs.codec import CODECS, Codec, decoder
from coopsim.comms.uplinks.uplink import MakeUplink, Uplink, uplink_factory
from coopsim.config.spec import instantiate, parse_spec
from coopsim.errors import CodecError
from coopsim.support.rng import stream
from coopsim.testing.harness import name_of, require_same, run_small, untouched
from coopsim.types import AgentSpec, Detections, Message, Observation, Sweep

_FRAMES = 4

Episode = list[dict[str, Message]]
Frames = Sequence[Mapping[str, Observation]]


def check_uplink(uplink: Any, **options: Any) -> None:
    """Check that an uplink keeps what environments and receivers rely on.

    Each message must be of its sender and frame, with a payload that its registered codec decodes, of the content that
    the uplink states. Frames in which nothing was sensed, and inboxes with unreadable messages, must do no
    harm. Observations must stay as they are. The same seed must give the same messages, whatever episodes were before
    and whatever the order of the agents.

    Args:
        uplink: a registered name or spec, a factory, or a policy, as for the option `uplink` of an environment.
        **options: options of the environment that gives the observations, as `lidar="HDL-32E"` or `cameras="surround"`.

    Raises:
        AssertionError: a check failed; the message names it.
        UnknownNameError: no uplink of that name is registered.
    """
    make = uplink_factory(uplink)
    specs, frames = _observed(options)
    first = _play(make, specs, frames)
    _play(make, specs, [{name: _emptied(each) for name, each in frame.items()} for frame in frames])
    rule = "an uplink must send the same again in a later episode"
    require_same(first, _play(make, specs, frames), rule, _differs)
    backwards = dict(reversed(list(specs.items())))
    rule = "an uplink must not depend on the order of the agents"
    require_same(first, _play(make, backwards, frames), rule, _differs)


class _Recorder(Uplink):
    """Sends nothing, and notes the observations."""

    content = "none"

    def __init__(self) -> None:
        self.frames: list[Mapping[str, Observation]] = []

    def message(self, sender: str, observation: Observation) -> None:
        return None

    def messages(self, observations: Mapping[str, Observation]) -> dict[str, Message]:
        self.frames.append(dict(observations))
        return {}


def _observed(options: Mapping[str, Any]) -> tuple[Mapping[str, AgentSpec], Frames]:
    """Return the agents of a small environment, and their observations by frame."""
    recorder = _Recorder()
    specs = run_small({**options, "uplink": lambda spec, rng: recorder}, _FRAMES, 3)
    return specs, recorder.frames


def _play(make: MakeUplink, specs: Mapping[str, AgentSpec], frames: Frames) -> Episode:
    """Run one episode, and check what each frame gives."""
    uplinks: dict[str, Uplink] = {}
    for name, spec in specs.items():
        made = make(spec, stream(1, "uplink", name))
        assert isinstance(made, Uplink), f"an uplink must be a coopsim Uplink, got {made!r}"
        content = getattr(made, "content", None)
        assert isinstance(content, str) and content, f"{name_of(made)}: content must be a name, got {content!r}"
        made.begin(spec, stream(1, "uplink state", name))
        uplinks[name] = made
    episode: Episode = []
    for frame in frames:
        sent: dict[str, Message] = {}
        for uplink in dict.fromkeys(uplinks.values()):
            served = {name: frame[name] for name in specs if uplinks[name] is uplink}
            with untouched(served, f"{name_of(uplink)} must leave its observations as they are"):
                messages = uplink.messages(served)
            for sender, message in messages.items():
                _check_message(uplink, sender, message, served)
            sent |= messages
        for name, uplink in uplinks.items():
            inbox = [message for sender, message in sent.items() if sender != name]
            inbox += [replace(message, payload=b"\x07nonsense") for message in inbox[:1]]
            try:
                uplink.hear(name, replace(frame[name], inbox=tuple(inbox)))
            except Exception as error:
                raise AssertionError(f"{name_of(uplink)} must hear any inbox, got {error!r}") from error
        episode.append(sent)
    return episode


def _check_message(uplink: Uplink, sender: str, message: object, served: Mapping[str, Observation]) -> None:
    name = name_of(uplink)
    assert sender in served, f"{name} must send for the agents that it is asked for, got {sender!r}"
    assert isinstance(message, Message), f"{name} must make messages, got {message!r}"
    assert message.sender == sender, f"{name} must name the sender {sender}, got {message.sender}"
    now_ns = served[sender].time_ns
    captured_ns = message.captured_ns
    assert captured_ns == now_ns, f"{name} must say when content was captured, {now_ns} ns, got {captured_ns}"
    assert message.codec in CODECS, f"{name}: codec {message.codec!r} is not registered"
    codec = decoder(message.codec)
    assert codec.content == uplink.content, f"{name} states {uplink.content!r}, and sends {codec.content!r}"
    try:
        codec.decode(message.payload)
    except CodecError as error:
        raise AssertionError(f"{name} must send what codec {message.codec!r} decodes: {error}") from error


def _differs(one: Message, two: Message) -> str:
    return "" if one.payload == two.payload else "the payloads"


def _emptied(observation: Observation) -> Observation:
    """Return the observation as if nothing had been around: no points, no detections."""
    sweeps = dict.fromkeys(observation.sweeps, Sweep.empty())
    return replace(observation, sweeps=sweeps, detections=Detections.empty())


_FLIPS, _RANDOM = 1000, 200


def check_codec(codec: str | Codec[Any] | type[Codec[Any]], contents: Sequence[Any]) -> None:
    """Check that a codec keeps what the channel and receivers rely on.

    Its class must be registered and can be made without arguments. What it encodes, any object of the class decodes;
    encoding the decoded content again must be stable. Bytes from anywhere are decoded or refused by `CodecError`, and
    take no more memory than `limit_bytes`; truncated payloads, and such with something after them, are refused. What
    is decoded cannot be written to. If the codec can leave something out, no payload is over its budget, unless it is
    that of empty content.

    Args:
        codec: a registered name or spec, an object, or a class.
        contents: content to try it on: several sizes, one of them empty.

    Raises:
        AssertionError: a check failed; the message names it.
        UnknownNameError: no codec of that name is registered, or the class is not.
    """
    made = _make(codec)
    name = CODECS.name_of(type(made))
    assert isinstance(made.content, str) and made.content, f"{name}: content must be a name, got {made.content!r}"
    limit = made.limit_bytes
    assert isinstance(limit, int) and limit > 0, f"{name}: limit_bytes must be a positive integer, got {limit!r}"
    assert len(contents) >= 2, "contents must be at least two, one of them empty"
    reader = type(made)()
    payloads = []
    for content in contents:
        payload = made.encode(content)
        assert type(payload) is bytes, f"{name}: encode must return bytes, got {type(payload).__name__}"
        assert payload == made.encode(content), f"{name} must encode the same content alike"
        payloads.append(payload)
        decoded = reader.decode(payload)
        again = made.encode(decoded)
        assert made.encode(reader.decode(again)) == again, f"{name} must be stable once content was encoded"
        writable = next(_writable(decoded), None)
        assert writable is None, f"{name}: decoded arrays must be read-only, {writable} is not"
    _check_refusals(name, made, payloads)
    _check_limit(name, made, payloads)
    if made.divisible:
        for content in contents:
            _check_budgets(name, made, content)


def _make(codec: str | Codec[Any] | type[Codec[Any]]) -> Codec[Any]:
    if isinstance(codec, str):
        name, parameters = parse_spec("codec", codec)
        return instantiate("codec", name, CODECS.get(name), parameters)
    made = codec() if isinstance(codec, type) else codec
    assert isinstance(made, Codec), f"a codec must be a coopsim Codec, got {made!r}"
    return made


def _check_refusals(name: str, codec: Codec[Any], payloads: Sequence[bytes]) -> None:
    rng = random.Random(0)
    longest, middle = max(payloads, key=len), sorted(payloads, key=len)[len(payloads) // 2]
    lengths = range(len(longest)) if len(longest) <= _FLIPS else sorted(rng.sample(range(len(longest)), _FLIPS))
    for length in lengths:
        assert not _decodes(name, codec, longest[:length]), f"{name} must refuse a payload cut off at {length} bytes"
    for more in (b"\0", b"\xff", longest, bytes(1_000_000)):
        assert not _decodes(name, codec, longest + more), f"{name} must refuse {len(more)} bytes after a payload"
    bits = range(8 * len(middle))
    for position in rng.sample(bits, min(len(bits), _FLIPS)):
        broken = bytearray(middle)
        broken[position // 8] ^= 1 << position % 8
        _decodes(name, codec, bytes(broken))
    for _ in range(_RANDOM):
        kept = rng.randrange(min(40, len(longest)) + 1)
        _decodes(name, codec, longest[:kept] + rng.randbytes(rng.randrange(300)))


def _decodes(name: str, codec: Codec[Any], payload: bytes) -> bool:
    """Return whether bytes are decoded; the decoded content must be encodable."""
    try:
        content = codec.decode(payload)
    except CodecError:
        return False
    except Exception as error:
        raise AssertionError(
            f"{name} must refuse bytes by CodecError, got {type(error).__name__} for {payload[:60]!r}: {error}"
        ) from error
    try:
        codec.encode(content)
    except Exception as error:
        raise AssertionError(f"{name} must encode what it decodes of {payload[:60]!r}, got {error!r}") from error
    return True


def _check_limit(name: str, codec: Codec[Any], payloads: Sequence[bytes]) -> None:
    longest = max(payloads, key=len)
    tracemalloc.start()
    try:
        for payload in (*payloads, *_announcing_much(longest)):
            tracemalloc.reset_peak()
            before = tracemalloc.get_traced_memory()[0]
            with contextlib.suppress(CodecError):
                codec.decode(payload)
            peak = tracemalloc.get_traced_memory()[1] - before
            assert peak <= codec.limit_bytes, (
                f"{name} declares limit_bytes {codec.limit_bytes}, and took {peak} bytes for {payload[:60]!r}"
            )
    finally:
        tracemalloc.stop()


def _announcing_much(payload: bytes) -> Iterator[bytes]:
    """Yield payloads whose heads announce as much as they can."""
    for at in range(min(len(payload), 40)):
        for width in (1, 2, 4):
            yield payload[:at] + b"\xff" * width + payload[at + width :]


def _check_budgets(name: str, codec: Codec[Any], content: Any) -> None:
    whole = codec.encode(content)
    assert codec.encode_within(content, len(whole)) == whole, f"{name} must leave nothing out where all fits"
    empty = len(codec.encode_within(content, 1))
    for budget_bytes in sorted({1, len(whole) // 4, len(whole) // 2, len(whole) - 1}):
        payload = codec.encode_within(content, budget_bytes)
        codec.decode(payload)
        assert len(payload) <= max(budget_bytes, empty), (
            f"{name} must keep within a budget of {budget_bytes} bytes, got {len(payload)}"
        )


def _writable(content: object, place: str = "content") -> Iterator[str]:
    if isinstance(content, np.ndarray):
        if content.flags.writeable:
            yield place
    elif is_dataclass(content):
        for field in fields(content):
            yield from _writable(getattr(content, field.name), f"{place}.{field.name}")
    elif isinstance(content, Mapping):
        for key, value in content.items():
            yield from _writable(value, f"{place}[{key!r}]")
    elif isinstance(content, (list, tuple)):
        for number, value in enumerate(content):
            yield from _writable(value, f"{place}[{number}]")
