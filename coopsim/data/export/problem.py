"""What a check of an exported folder finds."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Problem:
    """Something wrong in an exported folder.

    Attributes:
        file: path relative to the folder; empty: the folder as a whole.
        field: key, column or part in the file, as "vehicles.100004.extent"; empty: the file as a whole.
        reason: what is wrong and what is accepted.
    """

    file: str
    field: str
    reason: str

    def __str__(self) -> str:
        return ": ".join(filter(None, (self.file, self.field, self.reason)))
