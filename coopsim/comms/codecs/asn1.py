"""ASN.1 of ETSI's messages: modules compiled by asn1tools (the extra `etsi`), exact decoding, and places on earth.

Scenarios have no place on earth: the world frame is taken as east, north and up around latitude 0, longitude 0, where a
degree of either has the same length. Episodes begin with ETSI's time, at 2004-01-01T00:00:00Z.
"""

from __future__ import annotations

import zlib
from collections.abc import Iterator, Mapping
from importlib import resources
from typing import Any

from coopsim.errors import CodecError, MissingDependencyError

DEGREE_M = 111_319.49
"""A degree on the equator, in either direction: pi / 180 of WGS 84's larger radius."""

PROTOCOL = 2
"""Version in the header of every message."""

LONGEST_BYTES = 2**15
"""The longest payload that is decoded."""


def station_id(name: str) -> int:
    """Return the id of a station: the CRC-32 of the agent's name."""
    return zlib.crc32(name.encode())


def compiled(file: str, user: str) -> Any:
    """Return the compiled ASN.1 module of a file beside this one.

    Args:
        file: name of the file.
        user: name of the part that needs it, for the error.

    Raises:
        MissingDependencyError: asn1tools is not installed.
    """
    try:
        import asn1tools
    except ImportError as error:
        raise MissingDependencyError(f"{user} needs asn1tools: pip install 'coopsim[etsi]'") from error
    return asn1tools.compile_string(resources.files(__package__).joinpath(file).read_text(encoding="utf-8"), "uper")


def decode_exactly(module: Any, name: str, data: bytes) -> Any:
    """Decode the bytes of one ASN.1 type; raise `CodecError` unless they are exactly one value of it.

    The content is encoded again for comparison, because asn1tools does not report how many bytes it has read.
    """
    if len(data) > LONGEST_BYTES:
        raise CodecError(f"a {name} has at most {LONGEST_BYTES} bytes, got {len(data)}")
    try:
        content = module.decode(name, data)
        encoded = module.encode(name, content)
    except Exception as error:  # asn1tools' errors on invalid bytes have no common class
        raise CodecError(f"{len(data)} bytes are no {name}: {error}") from error
    if encoded != data:
        raise CodecError(f"{len(data)} bytes are not what coopsim reads of a {name}")
    return content


def encode_message(module: Any, name: str, numbers: tuple[int, int], body: str, content: Mapping[str, Any]) -> bytes:
    """Return a message: a header, and a body with content as ASN.1 values.

    Args:
        module: the compiled module.
        name: the message's type.
        numbers: its kind in ETSI's list, and the station's id.
        body: name of the body.
        content: the body.

    Raises:
        CodecError: a value is out of the standard's range.
    """
    header = {"protocolVersion": PROTOCOL, "messageID": numbers[0], "stationID": numbers[1]}
    try:
        return bytes(module.encode(name, {"header": header, body: content}, check_constraints=True))
    except Exception as error:  # asn1tools' errors on values out of range have no common class
        raise CodecError(f"the content does not fit into a {name}: {error}") from error


def decode_message(module: Any, name: str, kind: int, payload: bytes) -> Any:
    """Return header and body of a message, the inverse of `encode_message`.

    Raises:
        CodecError: the bytes are no such message, or have parts that are NULL in the module: coopsim does not read
            these.
    """
    message = decode_exactly(module, name, payload)
    header = message["header"]
    if (header["protocolVersion"], header["messageID"]) != (PROTOCOL, kind):
        raise CodecError(f"a {name} has protocol {PROTOCOL} and id {kind}, got {header}")
    if unread := sorted(set(_unread(message))):
        raise CodecError(f"the {name} has {', '.join(unread)}, which coopsim does not read")
    return message


def _unread(value: Any, name: str = "") -> Iterator[str]:
    """Yield the names of the parts that are NULL in the module."""
    if value is None:
        yield name
    elif isinstance(value, dict):
        for key, each in value.items():
            yield from _unread(each, key)
    elif isinstance(value, list):
        for each in value:
            yield from _unread(each, name)
    elif isinstance(value, tuple) and isinstance(value[0], str):  # a choice
        yield from _unread(value[1], value[0])
