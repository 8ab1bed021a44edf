"""ASN.1 of ETSI's messages: modules compiled by asn1tools (the extra `etsi`), exact decoding, and places on earth.

Scenarios have no place on earth: the world frame is taken as east, north and up around latitude 0, longitude 0, where a
degree of either has the same length. Episodes begin with ETSI's time, at 2004-01-01T00:00:00Z.
"""

from __future__ import annotations

from importlib import resources
from typing import Any

from coopsim.errors import CodecError, MissingDependencyError

DEGREE_M = 111_319.49
"""A degree on the equator, in either direction: pi / 180 of WGS 84's larger radius."""

PROTOCOL = 2
"""Version in the header of every message."""

LONGEST_BYTES = 2**15
"""The longest payload that is decoded."""


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
