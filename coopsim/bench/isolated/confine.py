"""Confinement of a policy's process before it has read a line of the policy: files, network, rights, resources.

Everything here is of Linux. Elsewhere, and where the system refuses a part, `confine` says so.
"""

from __future__ import annotations

import ctypes
import importlib
import os
import struct
import sys
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

OWN_USER, NAMED_FILES, READ_ONLY, NO_NETWORK = "user of its own", "named files alone", "nothing written", "no network"
"""Parts of a confinement that depend on the system, as pages name them."""

MEMORY_BYTES = 8 * 2**30
"""Most memory of a policy's process."""

_LIMITS = {"DATA": MEMORY_BYTES, "CPU": 4 * 3600, "NOFILE": 256, "FSIZE": 0, "CORE": 0}
_TASKS_OWN_USER, _TASKS = 64, 4096
_FIRST_USER, _USERS = 61_184, 4_096
"""Ids of users that Linux distributions leave to services without a name; the last of them may be missing."""

_LINUX = sys.platform == "linux"
_libc: Any = ctypes.CDLL(None, use_errno=True) if _LINUX else None
_NOT_DUMPABLE, _NO_NEW_RIGHTS = 4, 38  # PR_SET_DUMPABLE, PR_SET_NO_NEW_PRIVS
_CAPABILITIES_V3 = 0x20080522
_MOUNTS, _IPC, _NET, _USER = 0x00020000, 0x08000000, 0x40000000, 0x10000000  # CLONE_NEW...
_RECURSIVE, _PRIVATE, _HERE, _RDONLY = 0x8000, 1 << 18, -100, 1  # AT_RECURSIVE, MS_PRIVATE, AT_FDCWD, MOUNT_ATTR_RDONLY
_MOUNT_SETATTR, _LANDLOCK_CREATE, _LANDLOCK_ADD, _LANDLOCK_RESTRICT = 442, 444, 445, 446
_READ, _READ_FOLDER, _READ_WRITE = 0b101, 0b1101, 0b1000_0000_0000_0111  # execute, write, read, folder; ioctl

_SYSTEM = (
    *("/usr", "/lib", "/lib64", "/etc/ld.so.cache", "/etc/localtime", "/proc/cpuinfo", "/proc/meminfo", "/proc/stat"),
    *("/proc/self", "/proc/sys/vm", "/proc/driver", "/sys/devices/system", "/dev/urandom", "/dev/random", "/dev/zero"),
)


def close_memory() -> None:
    """Close this process's memory, environment and open files to other processes of its user."""
    if _LINUX:
        _libc.prctl(_NOT_DUMPABLE, 0, 0, 0, 0)


def other_user_reads() -> bool:
    """Return whether another user could read Python, coopsim and what it needs; only root can become one."""
    if not _LINUX or os.geteuid() != 0:
        return False
    child = os.fork()
    if child == 0:
        try:
            _become(_FIRST_USER)
            for path in (str(os.__file__), str(np.__file__), __file__):
                Path(path).read_bytes()
            os._exit(0)
        except OSError:
            os._exit(1)
    return os.waitpid(child, 0)[1] == 0


def confine(readable: Sequence[str], number: int, *, own_user: bool) -> dict[str, bool]:
    """Confine this process for good.

    Args:
        readable: files and folders that it may read, besides the system's, Python's and coopsim's.
        number: number of the process, so that each has a user of its own.
        own_user: it becomes another user (see `other_user_reads`).

    Returns:
        Which parts hold.
    """
    if not _LINUX:
        _limit(_TASKS)
        return dict.fromkeys((OWN_USER, NAMED_FILES, READ_ONLY, NO_NETWORK), False)
    no_network, read_only = _leave_namespaces()
    _libc.prctl(_NO_NEW_RIGHTS, 1, 0, 0, 0)
    _limit(_TASKS_OWN_USER if own_user else _TASKS)
    named_files = _only_files((*readable, *_python(), *_SYSTEM))
    if own_user:
        _become(_FIRST_USER + number % _USERS)
    _drop_capabilities()
    close_memory()
    return {
        OWN_USER: own_user,
        NAMED_FILES: named_files,
        READ_ONLY: read_only or named_files,
        NO_NETWORK: no_network,
    }


def _become(user: int) -> None:
    os.setgroups([])
    os.setresgid(user, user, user)
    os.setresuid(user, user, user)


def _drop_capabilities() -> None:
    """Give up what root may do beyond the owner of its files; another user has nothing to give up."""
    header, nothing = struct.pack("Ii", _CAPABILITIES_V3, 0), bytes(24)
    _libc.capset(header, nothing)


def _limit(tasks: int) -> None:
    """Limit memory, processor time, files and threads."""
    resource: Any = importlib.import_module("resource")  # of POSIX
    for name, most in {**_LIMITS, "NPROC": tasks}.items():
        what = getattr(resource, f"RLIMIT_{name}")
        _, hard = resource.getrlimit(what)
        least = most if hard == resource.RLIM_INFINITY else min(most, hard)
        resource.setrlimit(what, (least, least))


def _leave_namespaces() -> tuple[bool, bool]:
    """Leave the network and shared memory, and make all mounts read-only. Return which of both was possible."""
    alone = _NET | _IPC
    no_network = _libc.unshare(alone) == 0 or _libc.unshare(alone | _USER) == 0
    if _libc.unshare(_MOUNTS) != 0 or _libc.mount(b"none", b"/", None, 0x4000 | _PRIVATE, None) != 0:
        return no_network, False
    read_only = struct.pack("QQQQ", _RDONLY, 0, 0, 0)
    done = _libc.syscall(_MOUNT_SETATTR, _HERE, b"/", _RECURSIVE, read_only, ctypes.c_size_t(len(read_only)))
    return no_network, done == 0


def _python() -> list[str]:
    """Return what Python and coopsim are made of: the places of modules, and of compiled kernels."""
    kernels = os.environ.get("NUMBA_CACHE_DIR") or os.path.join(os.path.expanduser("~"), ".cache", "numba")
    return [sys.prefix, sys.base_prefix, *coopsim_folders(), kernels, *sys.path]


def coopsim_folders() -> list[str]:
    """Return the folder of coopsim, and those that links in it lead to, as `agents` and `envs` of a checkout."""
    whole = Path(__file__).parents[2].resolve()
    return [str(whole), *(str(each.resolve()) for each in sorted(whole.iterdir()) if each.is_symlink())]


def _only_files(readable: Iterable[str]) -> bool:
    """Let this process read named files and folders, write none, and reach no other process (Landlock)."""
    version = _libc.syscall(_LANDLOCK_CREATE, None, ctypes.c_size_t(0), 1)
    if version < 1:
        return False
    files = (1 << {1: 13, 2: 14, 3: 15, 4: 15}.get(version, 16)) - 1
    told = struct.pack("QQQ", files, 0b11, 0b11)  # TCP; abstract sockets and signals
    size = 8 if version < 4 else 16 if version < 6 else 24
    rules = _libc.syscall(_LANDLOCK_CREATE, told[:size], ctypes.c_size_t(size), 0)
    if rules < 0:
        return False
    for path in readable:
        _allow(rules, path, _READ_FOLDER if os.path.isdir(path) else _READ, files)
    for device in ("/dev/null", *map(str, Path("/dev").glob("nvidia*"))):
        _allow(rules, device, _READ_FOLDER if os.path.isdir(device) else _READ_WRITE, files)
    done = _libc.syscall(_LANDLOCK_RESTRICT, rules, 0)
    os.close(rules)
    return bool(done == 0)


def _allow(rules: int, path: str, rights: int, known: int) -> None:
    """Add a path to Landlock's rules, unless there is no such path."""
    try:
        place = os.open(path, os.O_PATH | os.O_CLOEXEC)
    except OSError:
        return
    rule = struct.pack("=Qi", rights & known, place)
    _libc.syscall(_LANDLOCK_ADD, rules, 1, rule, 0)
    os.close(place)
