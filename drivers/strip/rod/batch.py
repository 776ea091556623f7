"""Memory of a batch of simulated strips: creation, compaction as strips end, and
read-out.
"""

from collections.abc import Callable, Sequence
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from drivers.base.types import Array
from drivers.strip.model import StripModel
from drivers.strip.rod import layout as at
from drivers.strip.rod.lanes import LANE_COUNT
from drivers.strip.rod.layout import Batch
from drivers.strip.rod.lumping import lattice, lump, needs_terms

T = TypeVar("T", bound=np.generic)
CLOSING_SHARE = 0.75  # of the busy blocks that must suffice before a batch is compacted


def flat_batch(models: Sequence[StripModel], segments: int) -> Batch:
    """Batch of strips, one of each of `models`, flat and at rest along x, gripped at
    their ends.

    Strips lie beside each other in lanes of a processor's vector unit. `nature` holds
    their constants by node, `state` their motion, `work` and `band` are scratch memory
    of a step; `rows` counts nodes with the ghosts beyond both ends.
    """
    count = len(models)
    rows = segments + 3
    lanes = 1 if count < 2 else LANE_COUNT  # one strip is faster without SIMD

    # full blocks of lanes: spare ones copy the last strip
    slots = -(-count // lanes) * lanes
    filled = [*models, *[models[-1]] * (slots - count)]

    # laws beyond the elastic one need more constants and scratch memory
    rich = any(needs_terms(model) for model in models)
    natures = _for_each(filled, lambda model: lump(model, segments, rich=rich))
    arc = _for_each(models, lambda model: lattice(model.mechanics.length, segments))
    active = (np.arange(slots) < count).astype(np.float64)
    return Batch(
        nature=at.pack(natures, lanes),
        state=at.pack(_flat_states(natures), lanes),
        work=at.scratch(rows, at.RICH_WORK if rich else at.WORK, lanes),
        band=at.scratch(2 * rows + 4, at.COLUMN_COUNT, lanes),
        strips=np.arange(slots).reshape(-1, lanes),
        alive=at.pack(active[:, None, None], lanes),
        monitor=np.stack([_monitor(model) for model in models]),
        arc=arc,
        grip=np.stack([[length, 0.0, 0.0] for length in arc[:, -1]]),
        last=rows - 3,
        terms=1 if rich else None,
    )


def compact(batch: Batch) -> Batch:
    """Copy of `batch` whose active strips fill the first blocks, where that saves
    time.
    """
    lanes = batch.strips.shape[1]
    alive = at.unpack(batch.alive, lanes)[:, 0, 0] > 0
    busy = int(alive.reshape(-1, lanes).any(axis=1).sum())
    needed = -(-int(alive.sum()) // lanes)  # rounded up
    if busy == 0 or needed > CLOSING_SHARE * busy:
        return batch
    order = np.argsort(~alive, kind="stable")

    def reorder(blocks: Array) -> Array:
        return at.pack(at.unpack(blocks, lanes)[order], lanes)

    return batch._replace(
        nature=reorder(batch.nature),
        state=reorder(batch.state),
        alive=reorder(batch.alive),
        strips=batch.strips.ravel()[order].reshape(-1, lanes),
    )


def end_strips(batch: Batch, ended: NDArray[np.bool_]) -> Batch:
    """Copy of `batch` in which the strips of mask `ended` (n,) are marked as ended."""
    slots = np.append(ended, np.zeros(batch.strips.size - len(ended), dtype=bool))
    in_lanes = slots[batch.strips].reshape(batch.alive.shape)
    return batch._replace(alive=np.where(in_lanes, 0.0, batch.alive))


def living(batch: Batch) -> NDArray[np.bool_]:
    """Mask (n,) of the strips of `batch` that are still simulated."""
    alive = at.unpack(batch.alive, batch.strips.shape[1])[:, 0, 0] > 0
    return _by_strip(batch, alive)


def midlines(batch: Batch) -> Array:
    """Midlines (n, nodes, 2) of all strips of `batch`: x, z [m] of the nodes."""
    rows = at.unpack(batch.state, batch.strips.shape[1])
    return _by_strip(batch, rows[:, 1:-1, [at.X, at.Z]])


def _for_each(
    models: Sequence[StripModel], compute: Callable[[StripModel], Array]
) -> Array:
    """Stack (n, ...) of `compute(model)`, computed once for models that are the same
    object.
    """
    distinct = {id(model): model for model in models}
    values = {key: compute(model) for key, model in distinct.items()}
    return np.stack([values[id(model)] for model in models])


def _by_strip(batch: Batch, slots: NDArray[T]) -> NDArray[T]:
    """Values (n, ...) in the order of the strips, from those of the batch's lanes
    (slots, ...).
    """
    ordered = np.empty_like(slots)
    ordered[batch.strips.ravel()] = slots
    return ordered[: len(batch.arc)]


def _flat_states(natures: Array) -> Array:
    """Initial states (n, rows, fields) of n strips with the coefficients `natures` (n,
    rows, fields), flat and at rest.
    """
    rich = natures.shape[2] == at.RICH_NATURE
    spans = natures[:, :, at.SPAN]
    states = np.zeros((*natures.shape[:2], at.RICH_STATE if rich else at.STATE_SIZE))
    states[:, 1:, at.X] = np.cumsum(spans[:, :-1], axis=1)
    states[:, :, at.X] -= spans[:, :1]
    states[:, :, at.X1] = states[:, :, at.X]
    if rich:
        states[:, :, at.HELD] = np.inf
        bearing = natures[:, 1:-1, at.DESK].sum(axis=1)
        states[:, 1, at.HELD] = natures[:, 1, at.CLING] * bearing

    return states


def _monitor(model: StripModel) -> Array:
    """Initial monitor (MONITOR_SIZE,) of a flat strip: limits for desk contact and
    layer touch, and NaN for results to come.
    """
    mechanics = model.mechanics
    monitor = np.full(at.MONITOR_SIZE, np.nan)
    monitor[at.CONTACT_HEIGHT] = model.observation.contact_height
    monitor[at.OPENING] = 2 * mechanics.touch_gap
    monitor[at.TOUCH_GAP] = mechanics.touch_gap
    monitor[at.LENGTH] = mechanics.length
    monitor[at.GAP_HEIGHT] = np.inf
    return monitor
