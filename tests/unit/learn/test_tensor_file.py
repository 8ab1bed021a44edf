"""Files of tensors: equal content gives equal bytes, and no byte of a broken one is trusted."""

from __future__ import annotations

from pathlib import Path

import pytest
import torch
from safetensors.torch import load_file

from coopsim.errors import InvalidValueError
from coopsim.learn.tensor_file import read_header, read_tensors, write_tensors

TENSORS = {"b": torch.arange(6.0).reshape(2, 3).T, "a": torch.tensor([1, 2]), "none": torch.zeros(0, 4).half()}


def test_others_read_the_files_and_so_do_we(tmp_path: Path) -> None:
    path = tmp_path / "some.safetensors"
    write_tensors(path, TENSORS, {"key": "ü"})
    for found in (load_file(path), read_tensors(path, TENSORS)):
        assert all(torch.equal(found[name].float(), value.float()) for name, value in TENSORS.items())
    assert read_header(path)[1] == {"key": "ü"}


def test_the_order_of_names_does_not_matter(tmp_path: Path) -> None:
    first, second = tmp_path / "first.safetensors", tmp_path / "second.safetensors"
    write_tensors(first, TENSORS, {"x": "1", "y": "2"})
    write_tensors(second, dict(reversed(TENSORS.items())), {"y": "2", "x": "1"})
    assert first.read_bytes() == second.read_bytes()


@pytest.mark.parametrize(
    "content",
    [
        b"",
        b"\xff" * 8,
        (2**40).to_bytes(8, "little") + b"{}",
        (4).to_bytes(8, "little") + b"[1]]",
        (12).to_bytes(8, "little") + b'{"a": "text"}',
        (60_000).to_bytes(8, "little") + b"[" * 60_000,
        (43).to_bytes(8, "little") + b'{"a": {"dtype": "F32", "shape":[Infinity]}}',
    ],
)
def test_what_is_no_such_file_is_refused(content: bytes, tmp_path: Path) -> None:
    path = tmp_path / "broken.safetensors"
    path.write_bytes(content)
    with pytest.raises(InvalidValueError, match="is no safetensors file"):
        read_header(path)


def test_files_cut_short_and_large_ones_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "some.safetensors"
    write_tensors(path, TENSORS, {})
    with pytest.raises(InvalidValueError, match="must have at most 100 bytes, has"):
        read_tensors(path, TENSORS, most_bytes=100)
    path.write_bytes(path.read_bytes()[:-1])
    with pytest.raises(InvalidValueError, match="is no safetensors file"):
        read_tensors(path, TENSORS)


def test_types_that_weights_do_not_have_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "some.safetensors"
    write_tensors(path, {"a": torch.tensor([1])}, {})
    with pytest.raises(InvalidValueError, match="a must not be of type I64"):
        read_tensors(path, {"a": torch.zeros(1)})
