"""Isolation of policies from the world that they are measured in: processes of their own, and salted seeds."""

from __future__ import annotations

import hashlib
import hmac
import os
import pickle
import subprocess
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

import coopsim
from coopsim.bench.isolated.parcels import Pipe, unpack_parcel
from coopsim.catalog import PolicySpec
from coopsim.comms.codecs.codec import make_codec
from coopsim.comms.envelope import decode_message
from coopsim.comms.uplinks.uplink import ContentUplink, Uplink
from coopsim.errors import CoopsimError, InvalidValueError, IsolatedPolicyError
from coopsim.support.checks import require_positive
from coopsim.support.processes import cause_of_end, start_python
from coopsim.support.rng import derived_seed
from coopsim.types import AgentSpec, Message, Observation, Tracks

if TYPE_CHECKING:
    from coopsim.agents.policy import Policy


FRAME_LIMIT_S = 60.0
"""Default time limit of a frame."""

_LEAST_BYTES = 16


@dataclass(frozen=True, slots=True)
class Isolation:
    """Separation of policies from the world.

    Attributes:
        limit_s: time limit of a frame for policies in processes of their own; None: policies run in this process.
        salt: secret that decides, with a run's seed, its episode; None: the seed alone does. Nobody without it can make
            the same episodes.

    Raises:
        InvalidValueError: the limit is not positive, or the salt has less than 16 bytes.
    """

    limit_s: float | None = None
    salt: bytes | None = field(default=None, repr=False)

    def __post_init__(self) -> None:
        if self.limit_s is not None:
            require_positive(limit_s=self.limit_s)
        if self.salt is not None and len(self.salt) < _LEAST_BYTES:
            raise InvalidValueError(f"salt must have at least {_LEAST_BYTES} bytes, got {len(self.salt)}")

    @classmethod
    def of(cls, limit_s: float | None, salt: str | Path | None) -> Isolation:
        """Return the isolation with the salt in a file. Raises `InvalidValueError` if it cannot be read."""
        if salt is None:
            return cls(limit_s)
        try:
            return cls(limit_s, Path(salt).read_bytes().strip())
        except OSError as error:
            raise InvalidValueError(f"salt: cannot read {salt}: {error.strerror}") from error

    def seed(self, seed: int) -> int:
        """Return the seed of the episode of a run with this seed; below 2**62, as seeds of places are."""
        if self.salt is None:
            return seed
        return int.from_bytes(hmac.digest(self.salt, str(seed).encode(), "sha256")[:8], "big") >> 2

    def told_place(self, seed: int, place_seed: int | None) -> int | None:
        """Return the seed of a drawn place for results; of a salted episode's own seed it is a digest."""
        if self.salt is None or place_seed != seed:
            return place_seed
        return derived_seed(seed, "place") >> 1

    @contextmanager
    def policy(self, spec: PolicySpec) -> Iterator[Policy]:
        """Make a policy, and end its process, if it has one, in the end."""
        if self.limit_s is None:
            yield spec.make()
            return
        made = IsolatedPolicy(spec, self.limit_s)
        try:
            yield made
        finally:
            made.close()

    @contextmanager
    def described(self, spec: PolicySpec) -> Iterator[Policy]:
        """Make a policy in order to ask what it needs: one that is registered, whose code is trusted, in this process.

        A user's own class is not imported here if policies have processes of their own.
        """
        if not spec.place:
            policy = spec.make()
            if self.limit_s is not None:
                _require_no_truth(spec, policy)
            yield policy
            return
        with self.policy(spec) as policy:
            yield policy

    def require(self, options: Mapping[str, Any]) -> None:
        """Refuse options of environments that policies in processes of their own cannot have."""
        if self.limit_s is not None and options.get("budget_bytes") is not None:
            raise InvalidValueError(
                f"budget_bytes must be None for policies in processes of their own, got {options['budget_bytes']!r}"
            )

    def as_data(self) -> dict[str, Any]:
        """Return what a store and a protocol say: of the salt, a digest; empty without isolation and salt."""
        said: dict[str, Any] = {} if self.limit_s is None else {"own processes": True}
        if self.salt is not None:
            said["salt"] = hashlib.sha256(b"coopsim salt\0" + self.salt).hexdigest()
        return said


BEGIN_S = 600.0
"""Time limit of what is done once: importing, making the policy, beginning an episode, its first frame."""

_PROGRAM = "from coopsim.bench.isolated.guest import serve; serve()"

_KEPT = ("PATH", "HOME", "TMPDIR", "VIRTUAL_ENV", "COOPSIM_PRECISION")
_KEPT_BEGINNINGS = ("LANG", "LC_", "LD_", "DYLD_", "XDG_", "NUMBA_", "NPY_", "OPENBLAS_", "CUDA_")
"""What decides where programs are and how they calculate; not where recordings are, nor what salts seeds."""


class IsolatedPolicy(coopsim.Policy):
    """A policy that runs in a process of its own, which gets observations alone.

    That process gets the policy's spec, agents' specs, derived seeds, and observations; it answers tracks, maneuvers
    and messages, as data that name no code. One object serves all agents there, as it does without isolation. `limit_s`
    is the time limit of a frame.

    Raises:
        IsolatedPolicyError: the policy raised an error, took longer, answered nonsense, or its process died.
    """

    def __init__(self, spec: PolicySpec, limit_s: float) -> None:
        self._name, self._limit_s, self._frames = spec.text, limit_s, 0
        self._process = start_python(_PROGRAM, environment=_least_environment())
        assert self._process.stdin is not None and self._process.stdout is not None
        self._pipe = Pipe(self._process.stdout.fileno(), self._process.stdin.fileno())
        self._uplinks: dict[str, _RemoteUplink] = {}
        try:
            made = self.ask("make", spec)
            self.needs, self.method = coopsim.Needs(**made["needs"]), str(made["method"])
            self._guarded = bool(made["guarded"])
            _require_no_truth(spec, self)
        except (TypeError, KeyError) as error:
            self.close()
            raise self._error(f"answered nonsense: no needs ({error})") from error
        except BaseException:
            self.close()
            raise

    def close(self) -> None:
        """End the process."""
        self._process.kill()
        self._process.wait()
        for stream in (self._process.stdin, self._process.stdout):
            if stream is not None:
                stream.close()

    def ask(self, order: str, *arguments: Any) -> Any:
        """Give an order to the process, and wait for its answer."""
        limit_s = self._limit_s if self._frames else max(self._limit_s, BEGIN_S)
        try:
            self._pipe.send(pickle.dumps((order, arguments), protocol=5), limit_s)
            answer = unpack_parcel(self._pipe.receive(limit_s))
        except TimeoutError:
            raise self._error(f"has not answered within {limit_s:g} s") from None
        except (EOFError, BrokenPipeError):
            raise self._error(f"is gone: its process ended ({self._end()})") from None
        except ValueError as error:
            raise self._error(f"answered nonsense: {error}") from error
        if not isinstance(answer, Mapping) or not answer.keys() & {"answer", "error"}:
            raise self._error("answered nonsense: neither an answer nor an error")
        if "error" in answer:
            raise self._error(f"raised an error in its own process: {str(answer['error']).rstrip()}")
        return answer["answer"]

    def make_uplink(self, spec: AgentSpec, rng: np.random.Generator) -> Uplink:
        made = self.ask("make_uplink", spec, derived_seed(int(rng.integers(2**63)), "uplink"))
        try:
            if made["object"] == spec.name:
                self._uplinks[spec.name] = _RemoteUplink(self, made["content"], made["codec"], hears=made["hears"])
            return self._uplinks[made["object"]]
        except (TypeError, KeyError, CoopsimError) as error:
            raise self._error(f"answered nonsense: no uplink ({error})") from error

    def reset(self, agent_specs: Mapping[str, AgentSpec], seed: int = 0) -> None:
        self.require(agent_specs)
        self.specs, self._frames = dict(agent_specs), 0
        self.ask("reset", dict(agent_specs), seed)

    def act(  # type: ignore[override]  # it gets no infos
        self, observations: Mapping[str, Mapping[str, Any]]
    ) -> dict[str, dict[str, Any]]:
        actions: dict[str, dict[str, Any]] = self.ask("act", dict(observations))
        self._frames += 1
        return actions

    def judgements(self, agents: Iterable[str]) -> dict[str, tuple[dict[str, float], int]]:
        if not self._guarded:
            return {}
        named = list(agents)
        made = self.ask("judgements", named)
        try:
            return {agent: (_checked_trust(made[agent]["trust"]), int(made[agent]["passes"])) for agent in named}
        except (TypeError, KeyError, ValueError, AttributeError) as error:
            raise self._error(f"answered nonsense: no trust ({error})") from error

    @property
    def counts(self) -> Counter[str]:  # type: ignore[override]
        return Counter(self.ask("counts")["counts"])

    @property
    def rejected(self) -> Counter[tuple[str, str]]:  # type: ignore[override]
        """Number of messages that could not be read, all under one key: links are not told apart."""
        return Counter({("", ""): self.ask("counts")["rejected"]})

    def track(self, agent: str, observation: Observation) -> Tracks:
        raise InvalidValueError("a policy in a process of its own is asked for all agents together: call act")

    def _error(self, what: str) -> IsolatedPolicyError:
        return IsolatedPolicyError(f"policy {self._name!r} {what}")

    def _end(self) -> str:
        try:
            return cause_of_end(self._process.wait(5.0))
        except subprocess.TimeoutExpired:
            return "its pipe is closed"


class _RemoteUplink(ContentUplink[Any]):
    """An uplink in the policy's process. Its messages come as bytes on the air."""

    shows_content = False

    def __init__(self, policy: IsolatedPolicy, content: str, codec: str | None, *, hears: bool) -> None:
        self.content = content  # type: ignore[misc]  # of the class elsewhere
        self._policy, self._hears, self.codec_name = policy, hears, ""
        if codec is not None:
            self.codec_name, self.codec = make_codec(codec, content)

    def content_of(self, sender: str, observation: Observation) -> Any:
        raise InvalidValueError("content is made in the policy's own process: ask for messages")

    def prepare_budget(self) -> None:
        raise InvalidValueError(
            "budget_bytes must be None for policies in a process of their own, which make the bytes"
        )

    def messages(self, observations: Mapping[str, Observation]) -> dict[str, Message]:
        made = self._policy.ask("messages", dict(observations))
        try:
            return {name: decode_message(wire.tobytes()) for name, wire in made.items()}
        except (AttributeError, CoopsimError) as error:
            raise InvalidValueError(f"the policy's own process answered no messages: {error}") from error

    def hear(self, receiver: str, observation: Observation) -> None:
        if self._hears:
            self._policy.ask("hear", receiver, observation)


def _checked_trust(trust: Mapping[Any, Any]) -> dict[str, float]:
    """Return a process's answer if it is trust by sender. Raises `ValueError` for any other."""
    found = {str(sender): float(value) for sender, value in trust.items()}
    if not all(0 <= value <= 1 for value in found.values()):
        raise ValueError(f"trust must be in [0, 1], got {trust!r:.200}")
    return found


def _require_no_truth(spec: PolicySpec, policy: Policy) -> None:
    if policy.needs.truth:
        raise InvalidValueError(
            f"policies must not need the truth to run in processes of their own, which get none; {spec.text!r} does"
        )


def _least_environment() -> dict[str, str]:
    return {name: value for name, value in os.environ.items() if name in _KEPT or name.startswith(_KEPT_BEGINNINGS)}
