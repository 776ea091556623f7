"""Restricts the files that a process may open, by the kernel (Landlock) and by the interpreter.

The interpreter also refuses sealed files within a permitted folder. Imports
nothing of the project and no threads: what runs already is not barred.
"""

import ctypes
import os
import sys
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

CREATE, ADD, RESTRICT = 444, 445, 446  # numbers of the system calls, the same on every machine
LANDLOCK_VERSION, BENEATH = 1, 1
RULESET_SIZE = 8  # bytes of the attributes of a set of rules, of which one word is used
NO_NEW_PRIVILEGES, DIE_WITH_PARENT, KILL = 38, 1, 9
WRITE_FILE, READ_FILE, READ_DIR, TRUNCATE = 1 << 1, 1 << 2, 1 << 3, 1 << 14
CHANGE_RIGHTS = WRITE_FILE | sum(1 << bit for bit in range(4, 13))  # remove and make, of every kind
TRUNCATES = 3  # version from which truncation can be barred
OPENED = ("open", "os.listdir", "os.scandir", "os.chdir", "os.truncate")
STARTED = ("subprocess.Popen", "os.exec", "os.posix_spawn", "os.system", "os.fork", "os.forkpty")


@dataclass(frozen=True, slots=True)
class Policy:
    """Permissions of a process: readable trees, writable trees, and paths `sealed` within them."""

    readable: tuple[Path, ...]
    writable: tuple[Path, ...]
    sealed: tuple[Path, ...]


def restrict(permit: Policy) -> bool:
    """Restrict this process, its threads and children to `permit`; True if the kernel does it."""
    by_kernel = landlock(permit)
    sys.addaudithook(Guard(permit, kernel=by_kernel))
    return by_kernel


def die_with_parent() -> None:
    """Have the kernel end this process when its parent ends (Linux)."""
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(DIE_WITH_PARENT, KILL, 0, 0, 0)


def version() -> int:
    """Version of Landlock in this kernel; 0 where it has none."""
    if sys.platform != "linux":
        return 0
    return max(0, _syscall(CREATE, None, ctypes.c_size_t(0), ctypes.c_uint32(LANDLOCK_VERSION)))


def landlock(permit: Policy) -> bool:
    """Restrict this process by the kernel's Landlock; returns False where that is impossible.

    Rules only permit, so that a tree with something sealed in it is permitted piece by piece
    (Salaün, Landlock: unprivileged access control, Linux documentation, userspace-api).
    """
    known = version()
    if known < 1:
        return False
    truncate = TRUNCATE if known >= TRUNCATES else 0
    handled = ctypes.c_uint64(READ_FILE | READ_DIR | CHANGE_RIGHTS | truncate)
    rules = _syscall(
        CREATE, ctypes.byref(handled), ctypes.c_size_t(RULESET_SIZE), ctypes.c_uint32(0)
    )
    if rules < 0:
        return False
    try:
        for path, whole in _unsealed_parts(permit.readable, permit.sealed):
            _add_rule(rules, path, READ_FILE | READ_DIR if whole else READ_DIR)
        for path, whole in _unsealed_parts(permit.writable, permit.sealed):
            _add_rule(rules, path, handled.value if whole else READ_DIR)
        ctypes.CDLL(None).prctl(NO_NEW_PRIVILEGES, 1, 0, 0, 0)
        return _syscall(RESTRICT, ctypes.c_int(rules), ctypes.c_uint32(0)) == 0
    finally:
        os.close(rules)


class _Beneath(ctypes.Structure):
    _pack_ = 1
    _fields_ = (("allowed", ctypes.c_uint64), ("parent", ctypes.c_int32))


def _add_rule(rules: int, path: Path, access: int) -> None:
    """Add the permission `access` to a tree; a path that does not exist permits nothing."""
    if not path.is_dir():
        access &= READ_FILE | WRITE_FILE | TRUNCATE
    try:
        handle = os.open(path, os.O_PATH | os.O_CLOEXEC)
    except OSError:
        return
    try:
        rule = _Beneath(access, handle)
        _syscall(
            ADD, ctypes.c_int(rules), ctypes.c_int(BENEATH), ctypes.byref(rule), ctypes.c_uint32(0)
        )
    finally:
        os.close(handle)


def _syscall(number: int, *arguments: Any) -> int:
    return int(ctypes.CDLL(None, use_errno=True).syscall(ctypes.c_long(number), *arguments))


def _unsealed_parts(trees: Iterable[Path], sealed: Sequence[Path]) -> Iterator[tuple[Path, bool]]:
    """Split `trees` around `sealed` paths; yields each part, and whether it is free of them.

    Of a part that is not, only names may be listed, as the interpreter needs to find modules.
    """
    for tree in trees:
        if any(_within(tree, secret) for secret in sealed):
            continue
        holds = any(_within(secret, tree) for secret in sealed)
        yield tree, not holds
        if holds:
            yield from _unsealed_parts(sorted(tree.iterdir()), sealed)


def _within(path: Path, tree: Path) -> bool:
    return path.resolve().is_relative_to(tree.resolve())


class Guard:
    """Audit hook that refuses sealed files and, without Landlock, everything not permitted.

    Files that other code than Python's opens escape the hook.
    """

    def __init__(self, permit: Policy, *, kernel: bool) -> None:
        self._sealed = _texts(permit.sealed)
        self._writable = _texts(permit.writable)
        self._readable = _texts(permit.readable) + self._writable
        self._kernel = kernel

    def __call__(self, event: str, arguments: tuple[Any, ...]) -> None:
        """Raise PermissionError for an event that is not permitted."""
        if event in STARTED and not self._kernel:
            raise PermissionError(f"{event}: a sealed process starts no other")
        if event not in OPENED:
            return
        path = arguments[0] if arguments and arguments[0] is not None else "."
        if isinstance(path, int):
            return
        real = os.path.realpath(os.fsdecode(path))
        if _beneath(real, self._sealed) or not (
            self._kernel or self._is_permitted(real, arguments)
        ):
            raise PermissionError(f"{real}: is sealed from this process")

    def _is_permitted(self, real: str, arguments: tuple[Any, ...]) -> bool:
        flags = arguments[2] if len(arguments) > 2 else 0
        writes = isinstance(flags, int) and flags & (os.O_WRONLY | os.O_RDWR | os.O_CREAT)
        return _beneath(real, self._writable if writes else self._readable)


def _texts(paths: Sequence[Path]) -> tuple[str, ...]:
    return tuple(os.path.realpath(path) for path in paths)


def _beneath(real: str, trees: Sequence[str]) -> bool:
    return any(real == tree or real.startswith(tree.rstrip("/") + "/") for tree in trees)
