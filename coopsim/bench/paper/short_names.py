"""Names of policies for tables and figures."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

from coopsim.config.spec import parse_spec


def short_names(policies: Sequence[str]) -> dict[str, str]:
    """Return a short name of each policy: without parameters and file, where no other one is then called alike."""
    bare = {policy: _bare(policy) for policy in policies}
    count = Counter(bare.values())
    return {policy: policy if count[name] > 1 and policy != name else name for policy, name in bare.items()}


def _bare(policy: str) -> str:
    return parse_spec("policy", policy)[0].rpartition(":")[2]
