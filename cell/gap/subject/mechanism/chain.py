"""Simulates planar chains of hinges without drives by their own equations of motion.

Links lie below one another in x and z, each with its centre of mass on its line.
"""

import warnings
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise, repeat
from typing import Any

import numpy as np
from numba.core.errors import NumbaExperimentalFeatureWarning

from cell.gap.subject.mechanism.case import BatchFields, Case
from cell.gap.subject.mechanism.chain_kernel import integrate
from cell.gap.subject.mechanism.effects import torques
from cell.gap.subject.mechanism.forward import Forward
from cell.gap.subject.mechanism.load import Opened
from drivers.types import Array

OF_MODEL = ("body_mass", "body_inertia", "body_ipos", "body_pos", "dof_damping", "jnt_user")
DRAG, COMPLIANCE, END = "chain.drag", "chain.compliance", "chain.end"
ChainFields = dict[str, Array]
"""MuJoCo's fields by name, with the drag of air normal to the links [kg/m^2], the compliance of the
pivot in x [m/N], and where the last link ends [m] (NaN: like a uniform rod of its centre of mass
and inertia); each with the chain as its first axis.
"""


def fields_of(model: Any, count: int) -> ChainFields:
    """Fields of `count` equal chains, each with the chain as first axis, from a compiled model."""
    stated = {name: getattr(model, name) for name in OF_MODEL} | {"opt.gravity": model.opt.gravity}
    fields = {name: np.repeat(value[None], count, axis=0) for name, value in stated.items()}
    end = -model.site_pos[0, 2] if model.nsite else np.nan
    return fields | {DRAG: np.zeros(count), COMPLIANCE: np.zeros(count), END: np.full(count, end)}


def levers(fields: ChainFields) -> tuple[Array, Array, Array]:
    """Levers (B, n, n) [kg m^2], moments (B, n) [kg m] and lengths (B, n) [m] of the links."""
    # body 0 is the world, and body 1 hangs at the pivot; links point down, about y they turn
    mass, com = fields["body_mass"][:, 1:], -fields["body_ipos"][:, 1:, 2]
    inertia = fields["body_inertia"][:, 1:, 1]
    rod_end = np.minimum(2.0 * com, com + np.sqrt(3.0 * inertia / mass))[:, -1]
    end = np.where(np.isnan(fields[END]), rod_end, fields[END])
    length = np.column_stack([-fields["body_pos"][:, 2:, 2], end])
    count, n = mass.shape
    lever, moment = np.zeros((count, n, n)), np.zeros((count, n))
    for k in range(n):
        arms = [*length.T[:k], com[:, k]]
        for i, arm in enumerate(arms):
            moment[:, i] += mass[:, k] * arm
            for j, other in enumerate(arms):
                lever[:, i, j] += mass[:, k] * arm * other
        lever[:, k, k] += inertia[:, k]
    return lever, moment, length


def fastest(model: Any) -> float:
    """Angular frequency [rad/s] of the fastest small oscillation about hanging straight."""
    lever, moment, _ = levers(fields_of(model, 1))
    stiffness = np.diag(moment[0] * np.linalg.norm(model.opt.gravity))
    values = np.linalg.eigvals(np.linalg.solve(lever[0], stiffness))
    return float(np.sqrt(values.real.max()))


class PlanarChain(Forward):
    """Predicts the angles of planar chains by their equations of motion, whatever runs beside."""

    def __init__(self, opened: Opened, jobs: int, laws: frozenset[str]) -> None:
        super().__init__(opened, jobs, laws)
        with warnings.catch_warnings():  # laws are functions, and arguments of compiled ones
            warnings.simplefilter("ignore", NumbaExperimentalFeatureWarning)
            self._simulate([])

    def _simulate(self, cases: Sequence[Case]) -> tuple[Array, Array, Any]:
        """States (n, steps + 1, 2, joints) of n cases, empty commands, and no models."""
        fields = fields_of(self._mechanism.model, len(cases))
        for i, case in enumerate(cases):
            case.edit(BatchFields(fields.__getitem__, i))
        start = np.array([case.start for case in cases]).reshape(-1, 2, self._mechanism.model.nq)
        span = max((float(case.content.cut.t[-1]) for case in cases), default=0.0)
        steps = int(np.ceil(span / self._mechanism.step)) + 1
        with ThreadPoolExecutor(self._jobs) as pool:
            edges = np.linspace(0, len(cases), self._jobs + 1).astype(int)
            parts = [slice(*pair) for pair in pairwise(edges)]  # one for each thread
            shares = [{name: values[part] for name, values in fields.items()} for part in parts]
            found = pool.map(self._swing, shares, [start[part] for part in parts], repeat(steps))
            states = np.concatenate(list(found))
        return states, np.zeros((len(cases), steps, 0)), None

    def _swing(self, own: ChainFields, start: Array, steps: int) -> Array:
        """States (k, steps + 1, 2, n) of the joints of k chains from `start` (k, 2, n)."""
        lever, moment, length = levers(own)
        absolute = np.cumsum(start, axis=2)  # the kernel's angles are from upright, no joint's
        absolute[:, 0] += np.pi
        states = integrate(
            torques().function(self._laws), lever, moment,
            np.ascontiguousarray(own["opt.gravity"][:, [0, 2]]), length, own["dof_damping"],
            own["jnt_user"], own[DRAG], own[COMPLIANCE], absolute, self._mechanism.step, steps,
        )  # fmt: skip
        states[:, :, 0] -= np.pi
        states[..., 1:] -= states[..., :-1].copy()
        return np.asarray(states)
