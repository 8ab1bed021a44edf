"""The conformance check of an uplink."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from coopsim.catalog import parallel_env
from coopsim.comms.codecs.codec import CODECS, decoder
from coopsim.comms.uplinks.uplink import MakeUplink, Uplink, uplink_factory
from coopsim.errors import CodecError
from coopsim.support.rng import stream
from coopsim.testing.sensor_frames import digest
from coopsim.types import AgentSpec, Detections, Message, Observation, Sweep, Tracks
from coopsim.wire.actions import pack_tracks

_SMALL: dict[str, Any] = {"vehicles": 10, "lidar_columns": 256, "lidar": "VLP-16"}
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
        **options: of the environment whose observations it is given, as `lidar="HDL-32E"` or `cameras="surround"`.

    Raises:
        AssertionError: a check failed; the message names it.
        UnknownNameError: no uplink of that name is registered.
    """
    make = uplink_factory(uplink)
    specs, frames = _observed(options)
    first = _play(make, specs, frames)
    _play(make, specs, [{name: _emptied(each) for name, each in frame.items()} for frame in frames])
    _require_same(first, _play(make, specs, frames), "must send the same again in a later episode")
    backwards = dict(reversed(list(specs.items())))
    _require_same(first, _play(make, backwards, frames), "must not depend on the order of the agents")


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
    env = parallel_env("crossing", **{**_SMALL, **options, "uplink": lambda spec, rng: recorder, "max_cycles": _FRAMES})
    env.reset(seed=3)
    for _ in range(_FRAMES - 1):
        env.step({agent: {"tracks": pack_tracks(Tracks.empty())} for agent in env.agents})
    env.close()
    return env.agent_specs, recorder.frames


def _play(make: MakeUplink, specs: Mapping[str, AgentSpec], frames: Frames) -> Episode:
    """Run one episode, and check what each frame gives."""
    uplinks: dict[str, Uplink] = {}
    for name, spec in specs.items():
        made = make(spec, stream(1, "uplink", name))
        assert isinstance(made, Uplink), f"an uplink must be a coopsim Uplink, got {made!r}"
        content = getattr(made, "content", None)
        assert isinstance(content, str) and content, f"{_name(made)}: content must be a name, got {content!r}"
        made.begin(spec, stream(1, "uplink state", name))
        uplinks[name] = made
    episode: Episode = []
    for frame in frames:
        sent: dict[str, Message] = {}
        for uplink in dict.fromkeys(uplinks.values()):
            served = {name: frame[name] for name in specs if uplinks[name] is uplink}
            before = digest(served)
            for sender, message in uplink.messages(served).items():
                _check_message(uplink, sender, message, served)
                sent[sender] = message
            assert digest(served) == before, f"{_name(uplink)} must leave its observations as they are"
        for name, uplink in uplinks.items():
            inbox = [message for sender, message in sent.items() if sender != name]
            inbox += [replace(message, payload=b"\x07nonsense") for message in inbox[:1]]
            try:
                uplink.hear(name, replace(frame[name], inbox=tuple(inbox)))
            except Exception as error:
                raise AssertionError(f"{_name(uplink)} must hear any inbox, got {error!r}") from error
        episode.append(sent)
    return episode


def _check_message(uplink: Uplink, sender: str, message: object, served: Mapping[str, Observation]) -> None:
    name = _name(uplink)
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


def _require_same(first: Episode, other: Episode, what: str) -> None:
    for number, (one, two) in enumerate(zip(first, other, strict=True)):
        assert one.keys() == two.keys(), f"an uplink {what}: senders differ in frame {number}"
        for sender in one:
            assert one[sender].payload == two[sender].payload, (
                f"an uplink {what}: the payload of {sender} differs in frame {number}"
            )


def _emptied(observation: Observation) -> Observation:
    """Return the observation as if nothing had been around: no points, no detections."""
    sweeps = dict.fromkeys(observation.sweeps, Sweep.empty())
    return replace(observation, sweeps=sweeps, detections=Detections.empty())


def _name(uplink: Uplink) -> str:
    return type(uplink).__name__
