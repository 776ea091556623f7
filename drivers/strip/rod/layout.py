"""Memory layout of the rod engine: names of array fields, blocks, packing of strips
into lanes.

Arrays are (rows, fields[, LANE_COUNT]). Row r is node r - 1: row 1 the fixed edge, row
N + 1 the grasped edge; rows 0 and N + 2 are ghosts, one element beyond the ends, that
hold the tangents. Segment r runs from row r to row r + 1.
"""

from typing import Any, NamedTuple

import numpy as np

from drivers.base.types import Array

FIRST_FREE_NODE = 2  # row of the first free node
CACHE_LINE = 8  # doubles

# State: position, velocity, strain of bending and friction moment now, and one step
# before.
X, Z, VX, VZ, EPS, FRICTION = range(6)
X1, Z1, VX1, VZ1, EPS1, TENSION = range(6, 12)
STATE_SIZE = 12
# Of the ghost beyond the grip, which has no speed: the strip's pull on it [N].
GRIP_FORCE_X, GRIP_FORCE_Z = VX, VZ

# Nature: coefficients of a node (mass [kg], weight [N], bending) and of the segment
# that begins at it.
MASS, LOAD_X, LOAD_Z, DESK, BEND, CUBIC, FIFTH, CREST, DAMP, SLIP, STICK, REST = range(
    12
)
STRETCH, SPAN, SHARE, FLOOR = range(12, 16)
NATURE = 16

# More of both for `terms`: strain of a Maxwell element now and before, how far a
# segment has slid, the pull at which its end slides, and which way it does, moment of
# friction without a yield point; coefficients, of that friction its moment in full
# sliding [N m] and how soon it slides [1].
MAXWELL, MAXWELL1, SLID, HELD, SLIP_SIGN, GRADUAL = range(STATE_SIZE, STATE_SIZE + 6)
RICH_STATE = STATE_SIZE + 6
QUADRATIC, BRANCH, FADE, GRIPPED, CLING = range(NATURE, NATURE + 5)
DRAG, SLOW, OBLIQUE, ALONG, GRADUAL_SLIP, GRADUAL_PACE = range(NATURE + 5, NATURE + 11)
RICH_NATURE = NATURE + 11

# Work of one Newton iteration.
HAT_X, HAT_Z, BASE_X, BASE_Z, BASE_EPS, TANGENT = range(6)
TURN_X, TURN_Z, PULL_X, PULL_Z, S_XX, S_XZ, S_ZZ, TAUT, GROWTH = range(6, 15)
WORK = 15
BASE_MAXWELL, DRAG_XX, DRAG_XZ, DRAG_ZZ, STUCK, STUCK_GROWTH = range(WORK, WORK + 6)
RICH_WORK = WORK + 6

# Band: see `newton`.
COLUMN_COUNT = 7

# Observables of a strip after a step.
CONTACT_X, TIP_X, TIP_Z, HOLDING, GRIP_X, GRIP_Z = range(6)
OBSERVABLE_COUNT = 6

# Monitor of a strip: its limits, its layer gap one step ago, its touch, and when it
# failed.
CONTACT_HEIGHT, OPENING, TOUCH_GAP, LENGTH = range(4)
GAP_HEIGHT, GAP_X, GAP_S, TOUCH_TIME, TOUCH_X, TOUCH_S, FAILURE_TIME = range(4, 11)
MONITOR_SIZE = 11


class Batch(NamedTuple):
    """Memory of n simulated strips: solver arrays in blocks of lanes, and values of
    each strip.

    `nature`, the coefficients, and `state` (blocks, rows, fields[, LANE_COUNT]); `work`
    and `band`, which blocks share; `strips` and `alive`: which strip each lane holds
    and whether it is still simulated; of each strip `monitor` (n, MONITOR_SIZE), `arc`
    (n, nodes) and `grip` (n, 3), its last grip pose; `last` and `terms` as in Block.
    """

    nature: Any
    state: Any
    work: Any
    band: Any
    strips: Any
    alive: Any
    monitor: Any
    arc: Any
    grip: Any
    last: int
    terms: Any


class Block(NamedTuple):
    """Strips that are solved together: their coefficients and state, and shared work
    arrays.

    `nature` holds the coefficients. `last` is the row of the last free node; `terms` is
    None where no strip of the batch needs the kernels of `terms`: then the compiled
    code does not contain them.
    """

    nature: Any
    state: Any
    work: Any
    band: Any
    last: int
    terms: Any


def pack(values: Array, lanes: int) -> Array:
    """Pack the `values` (n, rows, fields) of n strips into blocks of lanes (n / lanes,
    rows, fields[, lanes]).
    """
    if lanes == 1:
        return _aligned_copy(values)
    blocks = values.reshape(-1, lanes, *values.shape[1:])
    return _aligned_copy(np.moveaxis(blocks, 1, -1))


def unpack(blocks: Array, lanes: int) -> Array:
    """Unpack blocks of lanes (n / lanes, rows, fields[, lanes]) to the values (n, rows,
    fields) of n strips.
    """
    if lanes == 1:
        return blocks
    return np.moveaxis(blocks, -1, 1).reshape(-1, *blocks.shape[1:-1])


def scratch(rows: int, fields: int, lanes: int) -> Array:
    """Work array of zeros (rows, fields[, lanes]), aligned to a cache line."""
    return _aligned_zeros((rows, fields) if lanes == 1 else (rows, fields, lanes))


def _aligned_copy(values: Array) -> Array:
    copy = _aligned_zeros(values.shape)
    copy[...] = values
    return copy


def _aligned_zeros(shape: tuple[int, ...]) -> Array:
    """Zeros of `shape` aligned to a cache line, so that no vector straddles two."""
    size = int(np.prod(shape))
    raw = np.zeros(size + CACHE_LINE)
    offset = -raw.ctypes.data % (raw.itemsize * CACHE_LINE) // raw.itemsize
    return raw[offset : offset + size].reshape(shape)
