"""Joint torques for which MuJoCo has no field, compiled and called by its engine.

All laws of the library are one compiled function of a joint; their parameters travel in
`jnt_user`, so that each simulation of a batch has its own. The same laws serve columns
of measured motion, uncompiled.
"""

import ctypes
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import cache
from typing import Any

import mujoco
import numba
import numpy as np
from numba import types

from drivers.base.jit import callback, kernel
from drivers.base.types import Array

HEAD = 2  # first user numbers of a joint: count of joints, its smoothing rate
# length of the view of an array of joints whose length is not known
MOST_JOINTS = 1 << 12
STRUCT_WORDS = 1 << 17  # pointers of a MuJoCo struct that are searched
_LOCK = threading.Lock()


def chain_laws(laws: Sequence[tuple[Callable[..., Array], int, int]]) -> Any:
    """Compile torque `laws` to the function `(q, v, load, p) -> torque` of their
    sum.
    """
    if not laws:
        return kernel(lambda q, v, load, p: 0.0)  # noqa: ARG005
    law, at, keys = laws[0]
    others = chain_laws(laws[1:])
    own: Any = kernel(law)

    def both(q, v, load, p):  # type: ignore[no-untyped-def]
        torque = 0.0
        if p[at : at + keys].any():
            torque = own(q, v, load, p, at)
        return torque + others(q, v, load, p)

    return kernel(both)


class Torques:
    """Joint-torque laws that MuJoCo lacks; `slots` user numbers of a joint hold their
    values.
    """

    def __init__(self, laws: Sequence[tuple[str, Callable[..., Array], int]]) -> None:
        """Assign user numbers of a joint to `laws`: name, torque function, number of
        values.
        """
        self._laws: dict[str, tuple[Callable[..., Array], int, int]] = {}
        self.slots = HEAD
        for name, law, count in laws:
            self._laws[name] = law, self.slots, count
            self.slots += count
        self.at = {name: first for name, (_, first, _) in self._laws.items()}
        self._callbacks: dict[frozenset[str], Any] = {}

    def along(self, q: Array, v: Array, load: Array, user: Array) -> Array:
        """Torques (m, joints) of all laws along a motion (m, joints), by `user`
        (joints, slots).
        """
        found = np.zeros_like(q)
        for j, p in enumerate(user):
            for law, at, keys in self._laws.values():
                if p[at : at + keys].any():
                    found[:, j] += law(q[:, j], v[:, j], load[:, j], p, at)
        return found

    @contextmanager
    def install(self, names: frozenset[str], model: Any) -> Iterator[None]:
        """Context in which MuJoCo adds torques of the laws `names` to models such as
        `model`.

        Other threads wait.
        """
        with _LOCK:
            if names not in self._callbacks:
                law = chain_laws([self._laws[name] for name in sorted(names)])
                self._callbacks[names] = _callback(law, model, self.slots)
            mujoco.set_mjcb_passive(self._callbacks[names].ctypes)
            # MuJoCo reads the clock a dozen times a step
            mujoco.set_mjcb_time(_zero().ctypes)
            try:
                yield
            finally:
                mujoco.set_mjcb_passive(None)
                mujoco.set_mjcb_time(None)


def _callback(law: Any, model: Any, slots: int) -> Any:
    """Compiled `mjcb_passive` of MuJoCo that adds the torque `law` of every joint.

    Arrays are found by the address that each has in a `model`, for the layout of
    MuJoCo's structs changes with its version.
    """
    data, pointers = mujoco.MjData(model), types.CPointer(types.CPointer(types.float64))
    user_at, qpos_at = _offset(model, model.jnt_user), _offset(data, data.qpos)
    qvel_at, passive_at = _offset(data, data.qvel), _offset(data, data.qfrc_passive)

    @callback(types.void(pointers, pointers))
    def add(model, data):  # type: ignore[no-untyped-def]
        user = numba.carray(model[user_at], (MOST_JOINTS, slots))
        for j in range(int(user[0, 0])):
            torque = law(data[qpos_at][j], data[qvel_at][j], 0.0, user[j])
            if torque != 0.0:
                numba.carray(data[passive_at], (MOST_JOINTS,))[j] += torque

    return add


@cache
def _zero() -> Any:
    """Compiled clock that always reads zero."""
    return callback(types.float64())(lambda: 0.0)


def _offset(struct: Any, array: Array) -> int:
    """Offset [pointers] in a MuJoCo struct of the pointer to `array` (n,)."""
    for at in range(STRUCT_WORDS):
        if (
            ctypes.c_uint64.from_address(struct._address + 8 * at).value
            == array.ctypes.data
        ):
            return at
    raise RuntimeError("this MuJoCo keeps its arrays where they were not found")
