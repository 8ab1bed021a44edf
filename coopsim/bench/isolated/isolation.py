"""What stands between a policy and the world that it is measured in."""

from __future__ import annotations

import hashlib
import hmac
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from coopsim.bench.isolated.isolated_policy import IsolatedPolicy
from coopsim.bench.policy_spec import PolicySpec
from coopsim.errors import InvalidValueError
from coopsim.support.checks import require_positive
from coopsim.support.rng import derived_seed

if TYPE_CHECKING:
    from coopsim.agents.policy import Policy

FRAME_LIMIT_S = 60.0
"""Default time limit of a frame."""

_LEAST_BYTES = 16


@dataclass(frozen=True, slots=True)
class Isolation:
    """How policies are kept from the world.

    Attributes:
        limit_s: policies run in processes of their own, which may take so long for a frame; None: in this process.
        salt: a secret that decides, with a run's seed, its episode; None: the seed alone does. Nobody without it can
            make the same episodes.

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
        """Return the isolation with the salt in a file.

        Raises:
            InvalidValueError: a value is not accepted, or the file cannot be read.
        """
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
        """Return what results say of a drawn place: its seed, but a digest of a salted episode's own seed."""
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
            yield spec.make()
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
