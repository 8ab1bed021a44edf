"""Texts of strangers that reach a terminal: control characters would move its cursor, and marks turn its text round."""

from __future__ import annotations

from coopsim.errors import InvalidValueError


def printable(text: str, kept: str = "") -> str:
    """Return a text with every character escaped that does not print, except those in `kept`, such as a newline."""
    return "".join(each if each.isprintable() or each in kept else ascii(each)[1:-1] for each in text)


def require_printable(**values: object) -> None:
    """Require texts whose characters all print: no control characters, and no marks of direction."""
    for name, value in values.items():
        if isinstance(value, str) and not value.isprintable():
            raise InvalidValueError(f"{name} must have characters that print, got {value!r}")
