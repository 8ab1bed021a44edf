"""The files of a new entry, to be filled in."""

from __future__ import annotations

from pathlib import Path

from coopsim.bench.entries.entry_folder import ABOUT, CARD, HEADINGS
from coopsim.errors import InvalidValueError
from coopsim.support.files import make_folder, write_whole

_ABOUT = """\
name: {name}
policy: policy.py:MyTracker(least_score=0.3) # or a name of `coopsim list policies`, or module:Class
authors: [Your Name]
license: MIT
url: "" # of a paper or of sources
"""

_HINTS = {
    HEADINGS[0]: "The method, in a paragraph: what it shares, how it fuses, how it tracks.",
    HEADINGS[1]: "The paper and the code that it follows, or: our own.",
    HEADINGS[2]: "Everything that differs; or: none.",
    HEADINGS[3]: "Data and towns that weights were trained on and numbers were chosen by; or: none.",
}

_POLICY = '''\
"""Late fusion of boxes above a score, to be replaced by your policy."""

from dataclasses import dataclass

from coopsim.agents.boxes import LateFusion


@dataclass(kw_only=True, eq=False)
class MyTracker(LateFusion):
    """Late fusion of boxes from a score on."""

    least_score: float = 0.3

    def fuse(self, groups):
        return super().fuse([found[found.score >= self.least_score] for found in groups])
'''


def write_template(folder: Path) -> list[Path]:
    """Write the files of a new entry. Raises `InvalidValueError` if the folder has files."""
    if folder.is_dir() and any(folder.iterdir()):
        raise InvalidValueError(f"a new entry needs an empty folder or a new one, and {folder} has files")
    make_folder(folder)
    card = "\n".join(f"## {heading}\n\n<!-- {hint} -->\n" for heading, hint in _HINTS.items())
    texts = {ABOUT: _ABOUT.format(name=folder.resolve().name), CARD: card, "policy.py": _POLICY}
    return [write_whole(folder / name, text) for name, text in texts.items()]
