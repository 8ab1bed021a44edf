"""Specs: things with parameters as a user writes them down, `name` or `name(parameter=value, ...)`.

Values are numbers, True, False (also true, false, as in YAML), None, texts (without quotes if they are names or look
like paths) and lists of these. Nothing is executed.
"""

from __future__ import annotations

import ast
import inspect
import keyword
import re
from collections.abc import Callable, Mapping
from typing import Any, TypeVar

from coopsim.errors import InvalidValueError
from coopsim.support.checks import require_choice
from coopsim.support.printable import require_printable

T = TypeVar("T")

_SHAPE = re.compile(r"(?P<target>[^()\s][^()]*?)\s*(?:\((?P<parameters>.*)\))?", re.DOTALL)
_QUOTED_OR_BARE = re.compile(r"""'(?:[^'\\]|\\.)*'|"(?:[^"\\]|\\.)*"|(?P<bare>[\w.~/-]+)(?=\s*(?:[,\])]|$))""")
_PATH = re.compile(r"(?=.*[^\W\d_])(?:[\w.~-]*/[\w.~/-]*|[\w~-][\w.~-]*\.[^\W\d_]\w*)")  # a letter, and / or a suffix
_YAML_WORDS = {"true": True, "false": False}


def parse_spec(
    kind: str, text: object, accepted: str = "name or name(parameter=value, ...)"
) -> tuple[str, dict[str, Any]]:
    """Split a spec into its name and its parameters.

    `kind` ("policy") and the `accepted` shapes are for the `InvalidValueError` of a text of another shape.
    """
    require_printable(**{kind: text.strip() if isinstance(text, str) else text})
    match = _SHAPE.fullmatch(text.strip()) if isinstance(text, str) else None
    if match is None:
        raise InvalidValueError(f"{kind} must be {accepted}, got {text!r}")
    return match["target"], _parameters(kind, str(text), match["parameters"] or "")


def spell_spec(name: str, parameters: Mapping[str, Any]) -> str:
    """Return the one spelling of a spec: parameters in alphabetical order, quotes only where they are needed."""
    given = ", ".join(f"{key}={_spelled(value)}" for key, value in sorted(parameters.items()))
    return f"{name}({given})" if given else name


def split_specs(text: str) -> tuple[str, ...]:
    """Split a list of specs at its commas, but not at those within brackets."""
    parts, depth = [""], 0
    for letter in text:
        depth += (letter in "([{") - (letter in ")]}")
        if letter == "," and depth == 0:
            parts.append("")
        else:
            parts[-1] += letter
    return tuple(part.strip() for part in parts)


def instantiate(kind: str, name: str, make: Callable[..., T], parameters: Mapping[str, Any]) -> T:
    """Make a thing by its class or factory; `kind` ("policy") and `name` are the user's words, for errors.

    Raises:
        UnknownNameError: there is no parameter of that name; the message lists the close ones.
        InvalidValueError: a value is not accepted, a required one is missing, or the class is abstract.
    """
    signature = inspect.signature(make)
    kinds = {parameter.name: parameter.kind for parameter in signature.parameters.values()}
    if inspect.Parameter.VAR_KEYWORD not in kinds.values():
        for parameter in parameters:
            require_choice("parameter", parameter, kinds, f"of {kind} {name!r}")
    if inspect.isabstract(make):
        missing = ", ".join(sorted(getattr(make, "__abstractmethods__", ())))
        raise InvalidValueError(f"{kind} {name!r} cannot be made: its class has no {missing}")
    try:
        signature.bind(**parameters)
    except TypeError as error:
        raise InvalidValueError(f"{kind} {name!r}: {error}") from error
    return make(**parameters)


def _parameters(kind: str, text: str, given: str) -> dict[str, Any]:
    try:
        call = ast.parse(f"spec({_with_quoted_paths(given)})", mode="eval").body
        if not isinstance(call, ast.Call) or call.args or any(each.arg is None for each in call.keywords):
            raise ValueError("a parameter has no name")
        return {str(each.arg): _value(each.value) for each in call.keywords}
    except (SyntaxError, ValueError) as error:
        raise InvalidValueError(
            f"{kind} {text!r}: parameters must be name=value with commas between them, the values numbers, True, "
            f"False, None, names, paths, other texts in quotes, or lists of these, got {given!r}"
        ) from error


def _with_quoted_paths(given: str) -> str:
    """Put quotes around values that look like paths: letters, digits and _ . ~ / -, with a / or a file's suffix."""

    def quoted(found: re.Match[str]) -> str:
        is_value = given[: found.start()].rstrip().endswith(("=", ",", "[", "("))
        return repr(found["bare"]) if found["bare"] and is_value and _is_path(found["bare"]) else found[0]

    return _QUOTED_OR_BARE.sub(quoted, given)


def _is_path(text: str) -> bool:
    if _PATH.fullmatch(text) is None:
        return False
    try:
        float(text)
    except ValueError:
        return True
    return False


def _value(node: ast.expr) -> Any:
    if isinstance(node, ast.Name):  # a text need not be quoted: delayed=replay
        return _YAML_WORDS.get(node.id, node.id)
    if isinstance(node, (ast.List, ast.Tuple)):
        return [_value(each) for each in node.elts]
    value = ast.literal_eval(node)
    if not (value is None or isinstance(value, (bool, int, float, str))):  # the order of a set is not always the same
        raise ValueError(f"{value!r} is no value of a parameter")
    return value


def _spelled(value: Any) -> str:
    if isinstance(value, str) and (_is_name(value) or _is_path(value)):
        return value
    return f"[{', '.join(map(_spelled, value))}]" if isinstance(value, list) else repr(value)


def _is_name(text: str) -> bool:
    return text.isidentifier() and not keyword.iskeyword(text) and text not in _YAML_WORDS
