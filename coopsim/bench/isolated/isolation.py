"""Isolation of policies from the world that they are measured in: processes of their own, and salted seeds."""

from __future__ import annotations

import hashlib
import hmac
import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from coopsim.bench.isolated.confine import close_memory
from coopsim.bench.isolated.isolated_policy import IsolatedPolicy, require_no_truth
from coopsim.catalog import PolicySpec
from coopsim.errors import InvalidValueError
from coopsim.support.checks import require_positive

if TYPE_CHECKING:
    from coopsim.agents.policy import Needs, Policy


FRAME_LIMIT_S = 60.0
"""Default time limit of a frame."""

_LEAST_BYTES, _MOST_BYTES = 16, 4096


@dataclass(frozen=True, slots=True)
class Isolation:
    """Separation of policies from the world.

    Attributes:
        limit_s: time limit of a frame for policies in processes of their own, one an agent; None: policies run in this
            process.
        salt: secret that decides, with a run's seed, its episode; None: the seed alone does. Nobody without it can make
            the same episodes.
        needs: needs that the policy in processes of its own has stated before: another answer is an error. None: it is
            asked.

    Raises:
        InvalidValueError: the limit is not positive, or the salt has less than 16 bytes.
    """

    limit_s: float | None = None
    salt: bytes | None = field(default=None, repr=False)
    needs: Needs | None = None

    def __post_init__(self) -> None:
        if self.limit_s is not None:
            require_positive(limit_s=self.limit_s)
        if self.salt is not None and len(self.salt) < _LEAST_BYTES:
            raise InvalidValueError(f"salt must have at least {_LEAST_BYTES} bytes, got {len(self.salt)}")
        if self.salt is not None:
            close_memory()

    @classmethod
    def of(cls, limit_s: float | None, salt_fd: int | None) -> Isolation:
        """Return the isolation with the salt in an open file, which is closed: its name would tell where the salt is.

        Raises:
            InvalidValueError: it cannot be read, or has no salt.
        """
        if salt_fd is None:
            return cls(limit_s)
        try:
            with os.fdopen(salt_fd, "rb", closefd=salt_fd > 2) as file:
                salt = file.read(_MOST_BYTES + 1).strip()
        except OSError as error:
            raise InvalidValueError(f"salt: cannot read the open file {salt_fd}: {error.strerror}") from error
        if len(salt) > _MOST_BYTES:
            raise InvalidValueError(f"salt must have at most {_MOST_BYTES} bytes, got more")
        return cls(limit_s, salt)

    def seed(self, seed: int) -> int:
        """Return the seed of the episode of a run with this seed; below 2**62, as seeds of places are."""
        return seed if self.salt is None else self._secret(str(seed))

    def guest_seed(self, seed: int) -> int:
        """Return the seed that a policy is told in place of another, which with a salt nobody finds by trying."""
        return seed if self.salt is None else self._secret(f"guest {seed}")

    def told_place(self, seed: int, place_seed: int | None) -> int | None:
        """Return the seed of a drawn place for results; of a salted episode's own seed it is a digest."""
        return place_seed if self.salt is None or place_seed != seed else self._secret(f"place {seed}")

    @contextmanager
    def policy(self, spec: PolicySpec) -> Iterator[Policy]:
        """Make a policy, and end its processes, if it has any, in the end."""
        if self.limit_s is None:
            yield spec.make()
            return
        made = IsolatedPolicy(spec, self.limit_s, self.guest_seed, self.needs)
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
                require_no_truth(spec, policy)
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

    @property
    def commitment(self) -> str | None:
        """Digest of the salt, which binds those who have it and tells nobody; None without a salt."""
        return None if self.salt is None else hashlib.sha256(b"coopsim salt\0" + self.salt).hexdigest()

    def seal(self, content: bytes) -> str:
        """Return what nobody without the salt can make of the content, 64 hexadecimal digits."""
        return hmac.digest(self.salt or b"", b"seal " + content, "sha256").hex()

    def _secret(self, text: str) -> int:
        """Return a number below 2**62 that the salt decides with a text, and that names neither."""
        return int.from_bytes(hmac.digest(self.salt or b"", text.encode(), "sha256")[:8], "big") >> 2

    def as_data(self) -> dict[str, Any]:
        """Return what a store and a protocol say: of the salt, a digest; empty without isolation and salt."""
        said: dict[str, Any] = {} if self.limit_s is None else {"own processes": True}
        if self.commitment is not None:
            said["salt"] = self.commitment
        return said
