"""NumPy's files of strangers: bounds before memory."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from coopsim.support.plain_arrays import read_npy, read_npz


def test_arrays_come_back(tmp_path: Path) -> None:
    given = {
        "a": np.arange(6.0).reshape(2, 3),
        "b": np.array(["car", "bus"]),
        "c": np.asfortranarray(np.eye(2)),
        "d": np.array(1),
    }
    np.savez_compressed(tmp_path / "x.npz", **given)  # type: ignore[arg-type]
    found = read_npz(tmp_path / "x.npz", 10_000)
    assert found.keys() == given.keys() and all(np.array_equal(found[name], given[name]) for name in given)
    assert read_npz(tmp_path / "x.npz", 10_000, ("b", "nobody")).keys() == {"b"}
    np.save(tmp_path / "a.npy", given["a"])
    np.testing.assert_array_equal(read_npy(tmp_path / "a.npy", 10_000), given["a"])


def test_what_is_larger_than_accepted_is_refused_before_it_is_unpacked(tmp_path: Path) -> None:
    np.savez_compressed(tmp_path / "zeros.npz", points=np.zeros((1000, 4)))
    with pytest.raises(ValueError, match="its arrays have 32128 bytes, and 20000 are accepted"):
        read_npz(tmp_path / "zeros.npz", 20_000)
    assert read_npz(tmp_path / "zeros.npz", 20_000, ()) == {}
    np.save(tmp_path / "zeros.npy", np.zeros(1000))
    with pytest.raises(ValueError, match="it has more than 1000 bytes"):
        read_npy(tmp_path / "zeros.npy", 1000)


@pytest.mark.parametrize(
    ("array", "changed", "message"),
    [
        (
            np.zeros((100, 4)),
            (b"(100, 4)", b"(999, 4)"),
            r"31968 bytes of the shape \(999, 4\), and has 3200",
        ),
        (np.zeros((100, 4)), (b"(100, 4)", b"(-10, 4)"), "an array announces -320 bytes"),
        (np.zeros((100, 4)), (b"NUMPY\x01", b"NUMPY\x03"), r"its format must be NumPy's 1.0 or 2.0, is 3.0"),
        (np.array([None]), (b"", b""), "an array announces objects"),
    ],
)
def test_a_header_that_does_not_fit_is_refused(
    array: np.ndarray, changed: tuple[bytes, bytes], message: str, tmp_path: Path
) -> None:
    np.save(tmp_path / "a.npy", array)
    (tmp_path / "a.npy").write_bytes((tmp_path / "a.npy").read_bytes().replace(*changed, 1))
    with pytest.raises(ValueError, match=message):
        read_npy(tmp_path / "a.npy", 10_000)
