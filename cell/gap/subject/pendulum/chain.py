"""From a pendulum's parameters and effects to the arrays that its dynamics integrate."""

from collections.abc import Mapping, Sequence

import numpy as np

from cell.gap.subject.pendulum.dynamics import Swings
from cell.gap.subject.pendulum.file import PendulumFile
from drivers.types import Array

JOINT_EFFECTS = {
    "dry_friction": "dry",
    "quadratic_damping": "quadratic",
    "wire_spring": "spring",
    "term_constant": "constant",
    "term_cubic": "cubic",
    "term_cubic_spring": "cubic_spring",
    "term_bent_viscous": "bent_viscous",
}

Effects = Mapping[str, Array]


def swings(pendulum: PendulumFile, bases: Array, effects: Sequence[Effects]) -> Swings:
    """Chains of base values (B, 4 n - 1), each with its own effects; see `base_values`.

    An effect that only others of the batch have is at its null, which changes no bit.
    """
    n = len(pendulum.links)
    damping, com, inertia, inner = np.split(bases.T, [n, 2 * n, 3 * n])
    mass = np.array([link.mass for link in pendulum.links])
    length = np.concatenate([inner, _end(pendulum, com[-1], inertia[-1])])
    lever, moment = _levers(mass, length, com, inertia)
    stacked = _stack_effects(effects)
    joint = {"viscous": damping}
    for name, law in JOINT_EFFECTS.items():
        if name in stacked:
            joint[law] = stacked[name]

    def single(name: str) -> Array | None:
        return stacked[name][0] if name in stacked else None

    return Swings(
        lever=lever,
        moment=moment,
        gravity=np.full(len(bases), pendulum.gravity),
        length=length,
        joint=joint,
        drag=single("air_drag"),
        tilt=single("frame_tilt"),
        compliance=single("pivot_compliance"),
    )


def _stack_effects(effects: Sequence[Effects]) -> dict[str, Array]:
    """Parameters (p, B) by effect, zero where a chain lacks it."""
    sizes = {name: len(values) for e in effects for name, values in e.items()}
    return {
        name: np.stack([e.get(name, np.zeros(size)) for e in effects], axis=1)
        for name, size in sizes.items()
    }


def _end(pendulum: PendulumFile, com: Array, inertia: Array) -> Array:
    """Where the last link ends (1, B): stated, or as a uniform rod of its com and inertia."""
    last = pendulum.links[-1]
    if last.length is not None:
        return np.full((1, len(com)), last.length)
    return np.minimum(2.0 * com, com + np.sqrt(3.0 * inertia / last.mass))[None]


def _levers(mass: Array, length: Array, com: Array, inertia: Array) -> tuple[Array, Array]:
    n, batch = com.shape
    lever, moment = np.zeros((n, n, batch)), np.zeros((n, batch))
    for k in range(n):
        arms = [*length[:k], com[k]]
        for i, arm in enumerate(arms):
            moment[i] += mass[k] * arm
            for j, other in enumerate(arms):
                lever[i, j] += mass[k] * arm * other
        lever[k, k] += inertia[k]
    return lever, moment


def fastest(pendulum: PendulumFile) -> float:
    """Angular frequency of the fastest small swing about hanging [rad/s]."""
    base = base_values(pendulum)
    chain = swings(pendulum, base[None], [{}])
    stiffness = np.diag(chain.moment[:, 0] * pendulum.gravity)
    values = np.linalg.eigvals(np.linalg.solve(chain.lever[:, :, 0], stiffness))
    return float(np.sqrt(values.real.max()))


def base_values(pendulum: PendulumFile) -> Array:
    """Base values (P,) of the file: damping, com, inertia by link, length of all but the last."""
    links = pendulum.links
    return np.array(
        [link.damping for link in links]
        + [link.com for link in links]
        + [link.inertia for link in links]
        + [link.length or 0.0 for link in links[:-1]]
    )
