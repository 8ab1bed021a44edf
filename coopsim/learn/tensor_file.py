"""Files of tensors and texts (safetensors), read with suspicion: nothing is unpickled, and sizes are checked first."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from coopsim.errors import InvalidValueError, MissingDependencyError
from coopsim.support.files import write_durably

MOST_BYTES = 64 * 2**20
"""Largest file of weights that is read."""

_MOST_HEADER_BYTES = 2**20
_DTYPES = {"F16": torch.float16, "BF16": torch.bfloat16, "F32": torch.float32, "I64": torch.int64}
_NAMES = {dtype: name for name, dtype in _DTYPES.items()}


def write_tensors(path: Path, tensors: Mapping[str, Tensor], texts: Mapping[str, str]) -> None:
    """Write tensors and texts by name, whole or not at all.

    Raises:
        InvalidValueError: the file cannot be written.
    """
    # Not by safetensors itself, which writes the texts in any order: the same content must give the same bytes.
    header: dict[str, Any] = {"__metadata__": dict(sorted(texts.items()))}
    parts, end = list[bytes](), 0
    for name, tensor in sorted(tensors.items()):
        content = tensor.detach().cpu().contiguous().numpy()
        parts.append(content.astype(content.dtype.newbyteorder("<")).tobytes())
        header[name] = {
            "dtype": _NAMES[tensor.dtype],
            "shape": list(tensor.shape),
            "data_offsets": [end, end + len(parts[-1])],
        }
        end += len(parts[-1])
    text = json.dumps(header).encode()
    text += b" " * (-len(text) % 8)
    write_durably(path, b"".join([len(text).to_bytes(8, "little"), text, *parts]))


def read_header(
    path: Path, most_bytes: int = MOST_BYTES
) -> tuple[dict[str, tuple[str, tuple[int, ...]]], dict[str, str]]:
    """Read the header of a file: type and shape of each tensor, and the texts.

    Raises:
        InvalidValueError: the file is missing, too large, or no safetensors file.
    """
    try:
        size = path.stat().st_size
        with path.open("rb") as file:
            length = int.from_bytes(file.read(8), "little")
            if size > most_bytes:
                raise InvalidValueError(f"{path}: must have at most {most_bytes} bytes, has {size}")
            if size < 8 or length > min(size - 8, _MOST_HEADER_BYTES):
                raise InvalidValueError(f"{path}: is no safetensors file")
            header = json.loads(file.read(length))
        texts = {str(key): str(value) for key, value in header.pop("__metadata__", {}).items()}
        return {name: (str(each["dtype"]), tuple(map(int, each["shape"]))) for name, each in header.items()}, texts
    except OSError as error:
        raise InvalidValueError(f"cannot read {path}: {error.strerror}") from error
    except (ValueError, TypeError, KeyError, AttributeError, OverflowError, RecursionError) as error:
        if isinstance(error, InvalidValueError):
            raise
        raise InvalidValueError(f"{path}: is no safetensors file") from error


def read_tensors(path: Path, wanted: Mapping[str, Tensor], most_bytes: int = MOST_BYTES) -> dict[str, Tensor]:
    """Read tensors by name: all of the names and shapes of `wanted`, and no other; floats become float32.

    Raises:
        InvalidValueError: a tensor is missing, unknown, of another shape or type, or not finite; or see `read_header`.
    """
    found, _ = read_header(path, most_bytes)
    for problem, names in (("lacks", wanted.keys() - found.keys()), ("has unknown", found.keys() - wanted.keys())):
        if names:
            raise InvalidValueError(f"{path}: {problem} tensors: {', '.join(sorted(names)[:5])} ({len(names)} in all)")
    for name, (dtype, shape) in found.items():
        kind = _DTYPES.get(dtype)
        if kind is None or kind.is_floating_point != wanted[name].is_floating_point():
            raise InvalidValueError(f"{path}: {name} must not be of type {dtype}")
        if shape != tuple(wanted[name].shape):
            raise InvalidValueError(f"{path}: {name} must be of shape {tuple(wanted[name].shape)}, is of {shape}")
    try:
        tensors: dict[str, Tensor] = _safetensors().load_file(path)
    except Exception as error:  # of safetensors' own class, which is not public in all versions
        raise InvalidValueError(f"{path}: is no safetensors file: {error}") from error
    for name, tensor in tensors.items():
        if tensor.is_floating_point():
            tensors[name] = tensor = tensor.float()
            if not bool(torch.isfinite(tensor).all()):
                raise InvalidValueError(f"{path}: {name} must be finite, and is not")
    return tensors


def _safetensors() -> Any:
    try:
        import safetensors.torch
    except ImportError as error:
        raise MissingDependencyError("files of weights need safetensors: pip install 'coopsim[learn]'") from error
    return safetensors.torch
