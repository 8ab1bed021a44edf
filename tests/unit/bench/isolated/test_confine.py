"""What a policy's process can and cannot do, tried from inside."""

from __future__ import annotations

import os
import sys
from pathlib import Path

import numpy as np
import pytest

import coopsim
from coopsim.bench.isolated import confine
from coopsim.bench.isolated.isolation import Isolation
from coopsim.catalog import PolicySpec
from coopsim.errors import IsolatedPolicyError
from coopsim.support.rng import stream
from tests.helpers.entries import SMALL

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="confinement is of Linux")

PROBE = """\
import os, resource, socket
import coopsim
from coopsim.types import Tracks

def possible(what):
    try:
        what()
        return 1
    except (OSError, MemoryError):
        return 0

def talk():
    with socket.create_connection(("127.0.0.1", int(os.path.basename(__file__)[1:-3])), 1.0):
        pass

class Probe(coopsim.Policy):
    needs = coopsim.Needs(uplink="none")

    def begin(self, spec, rng):
        here = os.path.dirname(__file__)
        tries = {
            "write": lambda: open(os.path.join(here, "said"), "w").close(),
            "touch": lambda: os.utime(__file__),
            "remove": lambda: os.remove(__file__),
            "connect": talk,
            "read": lambda: open(os.path.join(os.path.dirname(here), "label")).close(),
            "read own folder": lambda: open(os.path.join(here, "weights")).close(),
            "memory": lambda: bytearray(resource.getrlimit(resource.RLIMIT_DATA)[0] + 1),
            "root": lambda: os.setuid(0) if os.getuid() else os.chroot("/"),
        }
        for name, what in tries.items():
            self.counts[name] = possible(what)
        self.counts["files"] = resource.getrlimit(resource.RLIMIT_NOFILE)[0]
        self.counts["open"] = len(os.listdir("/proc/self/fd"))

    def track(self, agent, observation):
        return Tracks.empty()
"""


def test_a_policy_does_only_what_it_may(tmp_path: Path) -> None:
    import socket

    (tmp_path / "label").write_text("the truth")
    folder = tmp_path / "mine"
    folder.mkdir()
    (folder / "weights").write_text("w")
    with socket.create_server(("127.0.0.1", 0)) as listening:
        file = folder / f"p{listening.getsockname()[1]}.py"
        file.write_text(PROBE)
        with Isolation(60.0).policy(PolicySpec.parse(f"{file}:Probe")) as policy:
            held = policy.confinement  # type: ignore[attr-defined]
            counts = coopsim.evaluate(policy, "town", seed=1, lidar=None, max_cycles=1, **SMALL).counts
    agents = 2
    assert counts["memory"] == counts["root"] == 0 and counts["read own folder"] == agents
    assert counts["files"] == agents * 256 and counts["open"] < agents * 6
    if held[confine.READ_ONLY]:
        assert counts["write"] == counts["remove"] == 0 and file.exists()
    if held[confine.NAMED_FILES]:
        assert counts["read"] == 0
    if held[confine.NO_NETWORK]:
        assert counts["connect"] == 0


def in_a_child(*, own_user: bool) -> dict[str, bool]:
    """Confine a child of this process, and return what it found."""
    reader, writer = os.pipe()
    child = os.fork()
    if child == 0:
        try:
            held = confine.confine((), 7, own_user=own_user)
            said = [os.getuid() != 0, os.getgroups() == [], held[confine.OWN_USER]]
            os.write(writer, bytes(map(int, said)))
        finally:
            os._exit(0)
    os.close(writer)
    os.waitpid(child, 0)
    told = os.read(reader, 8)
    os.close(reader)
    return dict(zip(("other", "no groups", "said"), map(bool, told), strict=True))


@pytest.mark.skipif(os.name != "posix" or os.geteuid() != 0, reason="only root can be another user")
def test_root_becomes_a_user_without_groups() -> None:
    assert in_a_child(own_user=True) == {"other": True, "no groups": True, "said": True}


def test_another_answer_about_needs_is_an_error() -> None:
    spec, said = PolicySpec.parse("no_fusion"), coopsim.Needs(uplink="none", cameras=True)
    with pytest.raises(IsolatedPolicyError, match="said before"), Isolation(60.0, None, said).policy(spec):
        pass


def test_a_seed_that_a_policy_is_told_names_no_seed_of_a_town() -> None:
    salted, open_to_all = Isolation(60.0, b"a secret of enough bytes"), Isolation(60.0)
    assert open_to_all.guest_seed(7) == 7, "without a salt the seeds are those of one process"
    told = {salted.guest_seed(7), salted.seed(7), salted.told_place(salted.seed(7), salted.seed(7)), 7}
    assert len(told) == 4 and salted.guest_seed(7) != Isolation(60.0, b"another of enough bytes!").guest_seed(7)
    assert np.isfinite(stream(salted.guest_seed(7), "x").random())


def test_a_salt_comes_by_an_open_file_that_is_closed(tmp_path: Path) -> None:
    (tmp_path / "salt").write_bytes(b"  a secret of enough bytes\n")
    handle = os.open(tmp_path / "salt", os.O_RDONLY)
    assert Isolation.of(None, handle).salt == b"a secret of enough bytes"
    with pytest.raises(OSError, match="Bad file descriptor"):
        os.fstat(handle)


def test_all_of_coopsim_may_be_read_wherever_links_lead() -> None:
    allowed = [Path(folder) for folder in confine.coopsim_folders()]
    package = Path(coopsim.__file__).parent
    files = [path.resolve() for room in ("agents", "envs", "tracking") for path in (package / room).rglob("*.py")]
    assert len(files) > 50
    assert all(any(path.is_relative_to(folder) for folder in allowed) for path in files)
