"""Time stepping: second-order backward difference (BDF2) with variable step, or backward Euler.

With omega the step over the last one, a rate is gamma (value - base), gamma = (1 + 2 omega) / ((1 +
omega) h), base = ((1 + omega)^2 v - omega^2 v1) / (1 + 2 omega); omega = 0 is backward Euler and
starts a motion from rest.
"""

from typing import Any

from drivers.strip.rod import layout as at
from drivers.strip.rod.bending import direction, friction, strain
from drivers.strip.rod.compiled import kernel
from drivers.strip.rod.ends import slide
from drivers.strip.rod.lanes import choose, fma, load, store
from drivers.strip.rod.newton import desk, pair, solve
from drivers.strip.rod.terms import air_drag, predict_terms, remember


@kernel
def weights(omega: float) -> Any:
    """BDF2 weights of the last two values in the base of a rate, for a step ratio `omega`."""
    return (1.0 + omega) ** 2 / (1.0 + 2.0 * omega), -(omega**2) / (1.0 + 2.0 * omega)


@kernel
def predict(block: Any, h: float, omega: float, alive: Any) -> None:
    """Shift the history of the free nodes, extrapolate them, and store the bases in `work`."""
    state, work = block.state, block.work
    period = h * (1.0 + omega) / (1.0 + 2.0 * omega)
    now, old = weights(omega)
    ahead, behind = h * (1.0 + 0.5 * omega), -0.5 * omega * h
    for r in range(at.FIRST_FREE_NODE, block.last + 1):
        for axis in range(2):
            x, v = load(state, r, at.X + axis), load(state, r, at.VX + axis)
            x1, v1 = load(state, r, at.X1 + axis), load(state, r, at.VX1 + axis)
            base = fma(now, x, old * x1)
            store(work, r, at.BASE_X + axis, base)
            store(work, r, at.HAT_X + axis, fma(fma(now, v, old * v1), period, base))
            store(state, r, at.X1 + axis, choose(alive, x, x1))
            store(state, r, at.VX1 + axis, choose(alive, v, v1))
            guess = x + fma(ahead, v, behind * v1)
            store(state, r, at.X + axis, choose(alive, guess, x))


@kernel
def predict_strain(block: Any, omega: float) -> None:
    """Store the BDF2 bases of the bending strains in `work`; `finish` shifts their history."""
    now, old = weights(omega)
    for r in range(1, block.state.shape[0] - 1):
        eps, eps1 = load(block.state, r, at.EPS), load(block.state, r, at.EPS1)
        store(block.work, r, at.BASE_EPS, fma(now, eps, old * eps1))


@kernel
def finish(block: Any, rate: float, alive: Any) -> None:
    """Update velocities, history-dependent strains and moments, and sliding ends after a step."""
    state = block.state
    for r in range(at.FIRST_FREE_NODE, block.last + 1):
        for axis in range(2):
            v = rate * (load(state, r, at.X + axis) - load(block.work, r, at.BASE_X + axis))
            store(state, r, at.VX + axis, choose(alive, v, load(state, r, at.VX + axis)))
    before = direction(state, 0)
    for r in range(1, state.shape[0] - 1):
        here = direction(state, r)
        new, _ = strain(before, here)
        dry, _ = friction(block, r, new)
        eps = load(state, r, at.EPS)
        store(state, r, at.FRICTION, choose(alive, dry, load(state, r, at.FRICTION)))
        if block.terms is not None:
            remember(block, r, new, rate, alive)
        store(state, r, at.EPS1, choose(alive, eps, load(state, r, at.EPS1)))
        store(state, r, at.EPS, choose(alive, new, eps))
        before = here
    if block.terms is not None:
        slide(block, alive)


@kernel
def grip_force(block: Any, h: float, rate: Any, alive: Any) -> None:
    """Store the strip's force [N] on its grip, from the balance of momentum of the free nodes.

    The last segments are so short that their own shear shows what Newton's method leaves.
    """
    state, nature, work = block.state, block.nature, block.work
    end, ghost = state.shape[0] - 2, state.shape[0] - 1
    ux, uz, _, _ = direction(state, 1)
    (turn_x, turn_z), (pull_x, pull_z) = pair(work, 1, at.TURN_X), pair(work, 1, at.PULL_X)
    tension = load(state, 1, at.TENSION)
    shear = fma(turn_x, pull_x, turn_z * pull_z) / fma(turn_x, turn_x, turn_z * turn_z)
    x, z = -fma(shear, turn_x, tension * ux), -fma(shear, turn_z, tension * uz)
    for r in range(at.FIRST_FREE_NODE, end + 1):
        (weight_x, weight_z), (reaction, _) = pair(nature, r, at.LOAD_X), desk(block, r)
        x, z = x + weight_x, z + (weight_z + reaction)
    for r in range(at.FIRST_FREE_NODE, end):
        push = load(nature, r, at.MASS) * (1.0 / h)
        x = x - push * (load(state, r, at.VX) - load(state, r, at.VX1))
        z = z - push * (load(state, r, at.VZ) - load(state, r, at.VZ1))
        if block.terms is not None:
            (drag_x, drag_z), _ = air_drag(block, r, rate)
            x, z = x - drag_x, z - drag_z
    store(state, ghost, at.GRIP_FORCE_X, choose(alive, x, load(state, ghost, at.GRIP_FORCE_X)))
    store(state, ghost, at.GRIP_FORCE_Z, choose(alive, z, load(state, ghost, at.GRIP_FORCE_Z)))


@kernel
def attempt(block: Any, h: float, omega: float, alive: Any, tolerance: float) -> Any:
    """Advance the active lanes by one implicit step; returns the lanes that failed to converge."""
    rate = (1.0 + 2.0 * omega) / ((1.0 + omega) * h)
    predict(block, h, omega, alive)
    predict_strain(block, omega)
    if block.terms is not None:
        predict_terms(block, rate, weights(omega))
    unsolved = solve(block, rate, alive, tolerance)
    finish(block, rate, alive - unsolved)
    if block.last < block.state.shape[0] - 2:
        grip_force(block, h, rate, alive - unsolved)
    return unsolved
