"""Elements of XML files of strangers, one child of the root after the other: memory holds no whole file.

Python's own parser `expat` is used as it is: it reports lines, which messages name. Entities are refused, so no file
can grow or read others (`defusedxml` does the same, but keeps whole trees without lines). Size, depth and number of
elements are bounded, also of what a gzip file unpacks to.
"""

from __future__ import annotations

import gzip
import math
import re
import zlib
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from io import BufferedReader
from pathlib import Path
from typing import Any, Generic, TypeVar
from xml.parsers import expat

import numpy as np

from coopsim.errors import MapFileError
from coopsim.geometry.se3 import Floats

_CHUNK_BYTES = 1 << 20
_MOST_BYTES = 512 << 20
_MOST_ELEMENTS, _MOST_IN_ONE = 4_000_000, 1_000_000
"""Most elements of a file, and of one child of the root."""
_LONGEST = 8 << 20
"""Most letters of all attributes of an element."""
_DEEPEST = 64
LARGEST = 1e9
"""Largest number that is accepted, of either sign."""

_PLAIN = ("geoReference",)
"""Elements whose text is kept."""


_Made = TypeVar("_Made")


@dataclass(slots=True)
class Element:
    """An element: its tag, attributes, children, text (of few tags), file and line."""

    tag: str
    attributes: dict[str, str]
    file: str
    line: int
    children: list[Element] = field(default_factory=list)
    text: str = ""

    def error(self, wrong: str) -> MapFileError:
        """Return an error that names file, line and element, and says what is wrong."""
        name = self.attributes.get("id")
        return MapFileError(f"<{self.tag}{f' id={name!r}' if name else ''}> {wrong}").at(f"{self.file}:{self.line}")

    def all(self, *tags: str) -> list[Element]:
        """Return the children with one of these tags."""
        return [child for child in self.children if child.tag in tags]

    def at_path(self, *tags: str) -> list[Element]:
        """Return the children with the last tag, of children with the tag before it, and so on."""
        found = [self]
        for tag in tags:
            found = [child for each in found for child in each.children if child.tag == tag]
        return found

    def get(self, name: str, default: str = "") -> str:
        """Return an attribute without blanks around it, or what is taken where there is none."""
        return self.attributes.get(name, default).strip()

    def need(self, name: str) -> str:
        """Return an attribute that must be there, and must not be empty."""
        value = self.get(name)
        if not value:
            raise self.error(f"must have the attribute {name}")
        return value

    def number(self, name: str, default: float | None = None) -> float:
        """Return an attribute as a finite number; `default` where it is missing or empty, and is not None."""
        text = self.get(name)
        if not text and default is not None:
            return default
        value = _as_number(self.need(name))
        if not abs(value) <= LARGEST:
            raise self.error(f"{name} must be a number from -1e9 to 1e9, got {text!r}")
        return value

    def lane_number(self, name: str) -> int:
        """Return an attribute as the number of a lane, a small integer."""
        value = self.number(name)
        if value != int(value) or abs(value) > 10_000:
            raise self.error(f"{name} must be an integer from -10000 to 10000, got {self.get(name)!r}")
        return int(value)

    def shape(self, name: str = "shape") -> Floats:
        """Return an attribute of points, `x,y` or `x,y,z` with blanks between them, as (K, 3)."""
        points = [[_as_number(value) for value in point.split(",")] for point in self.need(name).split()]
        if not all(len(point) in (2, 3) and all(abs(value) <= LARGEST for value in point) for point in points):
            raise self.error(f"{name} must be points x,y or x,y,z of numbers from -1e9 to 1e9")
        return np.array([point if len(point) == 3 else [*point, 0.0] for point in points])


def _as_number(text: str) -> float:
    try:
        return float(text) if "_" not in text else math.nan
    except ValueError:
        return math.nan


def numbers(elements: Sequence[Element], names: Sequence[str], default: float | None = None) -> Floats:
    """Return attributes (N, len(names)) of elements as finite numbers."""
    try:
        rows = np.array([[_as_number(each.attributes[name]) for name in names] for each in elements])
        if (np.abs(rows) <= LARGEST).all():
            return rows.reshape(len(elements), len(names))
    except KeyError:
        pass
    return np.array([[each.number(name, default) for name in names] for each in elements])


def read_elements(path: Path, skipped: Iterable[str] = ()) -> Iterator[Element]:
    """Yield the root of an XML file, plain or in gzip, without children; then each child of it, with all that it has.

    Args:
        path: the file.
        skipped: tags whose elements are passed over, with all in them.

    Raises:
        MapFileError: the file is missing, no XML, cut off or damaged, has entities, or is too large.
    """
    yield from _parsed(path, _Builder(str(path), frozenset(skipped)))


Start = tuple[str, dict[str, str]]
"""Tag and attributes of an element."""


def read_starts(path: Path) -> Iterator[Start]:
    """Yield tag and attributes of every element of an XML file, plain or in gzip, in the order in which they begin.

    For files of millions of small elements: no element is made of them.

    Raises:
        MapFileError: the file is one that `read_elements` refuses.
    """
    yield from _parsed(path, _Starts(str(path)))


def starts_of(file: str, *parts: bytes) -> list[Start]:
    """Return tag and attributes of every element of a text that is given in parts.

    Raises:
        MapFileError: the parts are together no XML, or have entities; names the `file`.
    """
    parser = _Starts(file)
    for part in parts:
        parser.feed(part)
    parser.feed(b"", last=True)
    return parser.take()


def _parsed(path: Path, builder: _Parser[_Made]) -> Iterator[_Made]:
    """Yield what a parser makes of a file, part by part."""
    try:
        with opened(path) as file:
            while chunk := file.read(_CHUNK_BYTES):
                builder.feed(chunk)
                yield from builder.take()
        builder.feed(b"", last=True)
    except FileNotFoundError:
        raise MapFileError(f"no file {path}") from None
    except (gzip.BadGzipFile, zlib.error, EOFError):
        raise MapFileError(f"{path}: the gzip file is damaged or cut off; {builder.where()}") from None
    except OSError as error:
        raise MapFileError(f"cannot read {path}: {error.strerror}") from error
    yield from builder.take()


def opened(path: Path) -> gzip.GzipFile | BufferedReader:
    """Return a file that is open for reading, plain or in gzip by its first bytes."""
    with open(path, "rb") as file:
        packed = file.read(2) == b"\x1f\x8b"
    return gzip.open(path) if packed else open(path, "rb")


class _Parser(Generic[_Made]):
    """Parse parts of a file; what is made of them is taken between parts."""

    def __init__(self, file: str) -> None:
        self._file = file
        self._done: list[_Made] = []
        self._bytes = 0
        self._parser: Any = expat.ParserCreate()
        self._parser.buffer_text = True
        self._parser.StartElementHandler = self._start
        self._parser.EntityDeclHandler = self._refuse

    def feed(self, chunk: bytes, *, last: bool = False) -> None:
        """Parse a part of the file."""
        self._bytes += len(chunk)
        if self._bytes > _MOST_BYTES:
            raise self._error(f"the file has more than {_MOST_BYTES >> 20} MB of text, which is the most accepted")
        try:
            self._parser.Parse(chunk, last)
        except expat.ExpatError as error:
            text = re.sub(r": line .*", "", str(error))
            raise self._error(f"this is no XML file, or it is cut off ({text}); {self.where()}") from None
        except (LookupError, ValueError) as error:  # an encoding that Python does not know
            raise self._error(f"this is no XML file in a known encoding ({error})") from None

    def take(self) -> list[_Made]:
        """Return what is complete, and forget it."""
        done, self._done = self._done, []
        return done

    def where(self) -> str:
        """Return which element is open."""
        return "accepted: a whole file"

    def _error(self, wrong: str) -> MapFileError:
        return MapFileError(wrong).at(f"{self._file}:{self._parser.CurrentLineNumber}")

    def _start(self, tag: str, attributes: dict[str, str]) -> None:
        raise NotImplementedError

    def _refuse(self, name: str, *_: object) -> None:
        raise self._error(f"the entity {name!r} is refused; accepted: XML without entities of its own")


class _Starts(_Parser[Start]):
    """List the beginnings of elements."""

    def _start(self, tag: str, attributes: dict[str, str]) -> None:
        self._done.append((tag, attributes))


class _Builder(_Parser[Element]):
    """Make elements from parts of a file."""

    def __init__(self, file: str, skipped: frozenset[str]) -> None:
        super().__init__(file)
        self._skipped = skipped
        self._open: list[Element] = []
        self._elements = self._in_one = self._passed_over = 0
        self._parser.EndElementHandler = self._end

    def where(self) -> str:
        """Return which element is open."""
        return f"it ends within {self._path()}; accepted: a whole file" if self._open else "accepted: a whole file"

    def _path(self) -> str:
        return " ".join(
            f"<{each.tag}{f' id={name!r}' if (name := each.get('id')) else ''}>" for each in self._open[-4:]
        )

    def _start(self, tag: str, attributes: dict[str, str]) -> None:
        self._elements += 1
        if self._elements > _MOST_ELEMENTS:
            raise self._error(f"the file has more than {_MOST_ELEMENTS:,} elements, which is the most accepted")
        if self._passed_over or tag in self._skipped:
            self._passed_over += 1
            return
        self._in_one = self._in_one + 1 if len(self._open) > 1 else 0
        if self._in_one > _MOST_IN_ONE or sum(map(len, attributes.values())) > _LONGEST:
            most = f"{_MOST_IN_ONE:,} elements within it, or {_LONGEST >> 20} MB of attributes"
            raise self._error(f"<{tag}> of {self._path()} is too large; accepted: up to {most}")
        if len(self._open) >= _DEEPEST:
            raise self._error(f"<{tag}> is nested {_DEEPEST} elements deep, which is more than is accepted")
        element = Element(tag, attributes, self._file, self._parser.CurrentLineNumber)
        if len(self._open) == 0:
            self._done.append(element)
        elif len(self._open) > 1:
            self._open[-1].children.append(element)
        self._open.append(element)
        self._parser.CharacterDataHandler = self._text if tag in _PLAIN else None

    def _end(self, tag: str) -> None:
        if self._passed_over:
            self._passed_over -= 1
            return
        element = self._open.pop()
        self._parser.CharacterDataHandler = None
        if len(self._open) == 1:
            self._done.append(element)

    def _text(self, text: str) -> None:
        if len(self._open[-1].text) < _CHUNK_BYTES:
            self._open[-1].text += text
