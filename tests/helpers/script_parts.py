"""Parts as a user's script registers them: classes of `__main__`, which no other process can import."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from coopsim.interfaces.defense import DEFENSES

_SCRIPT = """
from helpers.clip_sources import NumberedClips
from coopsim.interfaces.defense import DEFENSES, Defense

@DEFENSES.register("of_the_script")
class OfTheScript(Defense):
    lowest = 0.25

    def judge(self, reception):
        return self.lowest, DEFENSES.get("of_the_script") is OfTheScript

class Source(NumberedClips):
    def clip(self, index):
        return super().clip(int(100 * DEFENSES.get("of_the_script")().judge(None)[0]))
"""


@contextmanager
def parts_of_a_script() -> Iterator[dict[str, Any]]:
    """Run the script, and yield its names; its registrations are forgotten at the end."""
    names: dict[str, Any] = {"__name__": "__main__"}
    exec(_SCRIPT, names)
    try:
        yield names
    finally:
        forget("of_the_script")


def forget(name: str) -> None:
    """Remove a defence from the registry, as in a process that does not know it."""
    DEFENSES._entries.pop(name, None)
    DEFENSES._homes.pop(name, None)
