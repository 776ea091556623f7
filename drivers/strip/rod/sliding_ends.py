"""Sliding of a strip's ends: in its grip, and of a loose fixed edge on the desk."""

from typing import Any

from drivers.base.jit import kernel
from drivers.strip.rod import layout as at
from drivers.strip.rod.bending import direction
from drivers.strip.rod.lanes import below, load, select, splat, store
from drivers.strip.rod.newton import desk_reaction
from drivers.strip.rod.terms import HUGE, slip_direction, slip_limit


@kernel
def slip_length(block: Any, r: int) -> Any:
    """Distance [m] by which the strip slid at segment `r` in the step just solved."""
    stretch, span = load(block.nature, r, at.STRETCH), load(block.nature, r, at.SPAN)
    _, _, _, length = direction(block.state, r)
    taut = stretch * (length - span - load(block.state, r, at.SLID))
    sign = slip_direction(block, r, taut)
    level = select(sign, slip_limit(block, r), -load(block.state, r, at.HELD))
    return select(sign * sign, (taut - level) / stretch, 0.0)


@kernel
def slide_in_grip(block: Any, alive: Any) -> None:
    """Lengthen the segment at the grip by the length that slid out of the grip in this
    step.

    That piece is straight and massless, valid for a few per cent of the strip. Arc
    lengths end at the edge that was grasped, so l1 does not grow by it.
    """
    r = block.state.shape[0] - 3
    before = load(block.state, r, at.SLID)
    store(
        block.state, r, at.SLID, select(alive, before + slip_length(block, r), before)
    )


@kernel
def slide_edge(block: Any, alive: Any) -> None:
    """Move a loose fixed edge by the distance it slid, and update the friction that
    holds it.

    All friction of the lying part acts at its edge: that part is straight and hardly
    stretches, so it slides as a whole when the pull exceeds friction times the normal
    force of the desk.
    """
    state = block.state
    away = slip_length(block, 1)
    for r in range(2):
        x = load(state, r, at.X)
        store(state, r, at.X, select(alive, x + away, x))
    borne = splat(state, 0.0)
    for r in range(1, block.last + 1):
        reaction, _ = desk_reaction(block, r)
        borne = borne + reaction
    cling, before = load(block.nature, 1, at.CLING), load(state, 1, at.HELD)
    held = select(below(HUGE, cling), cling, cling * borne)
    store(state, 1, at.HELD, select(alive, held, before))


@kernel
def slide_ends(block: Any, alive: Any) -> None:
    """Apply the sliding of both ends in the active lanes, after a step."""
    slide_in_grip(block, alive)
    slide_edge(block, alive)
