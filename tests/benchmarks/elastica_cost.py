"""What PyElastica costs on a rod like the strip: a subject of the benchmark of engines.

No desk, no gripper, no damping: a clamped rod swings freely. So only its cost can be compared.
"""

import time
from typing import Any

import numpy as np

LENGTH, ELEMENTS = 0.6, 60
RADIUS = 0.0005  # m; with the bending stiffness of fabric its stretch is then realistic too
STEPS = (1e-4, 5e-5, 2e-5, 1e-5, 5e-6)  # s, explicit; the first is its authors' rule
SPAN = 0.05  # s simulated
STRETCHED = 0.01  # of the length, beyond which a step was too long


def cost_and_step(rigidity: float, linear_density: float) -> tuple[float, float]:
    """Seconds per simulated second of `ELEMENTS` elements, and the longest step that holds [s].

    `rigidity` [N m^2], `linear_density` [kg/m]. Raises ImportError where PyElastica is not
    installed.
    """
    for dt in STEPS:
        cost, length = _swing(rigidity, linear_density, dt)
        if abs(length / LENGTH - 1) < STRETCHED:
            return cost, dt
    raise ArithmeticError("PyElastica holds at none of the steps tried")


def _swing(rigidity: float, linear_density: float, dt: float) -> tuple[float, float]:
    """Cost per simulated second, and the length of the rod at the end [m]."""
    import elastica as ea

    simulator, rod = _clamped(ea, rigidity, linear_density)
    stepper = ea.PositionVerlet()
    now = stepper.step(simulator, 0.0, dt)  # compiles
    begun = time.thread_time()
    with np.errstate(all="ignore"):
        for _ in range(round(SPAN / dt)):
            now = stepper.step(simulator, now, dt)
    cost = (time.thread_time() - begun) / SPAN
    return cost, float(np.linalg.norm(np.diff(rod.position_collection), axis=0).sum())


def _clamped(ea: Any, rigidity: float, linear_density: float) -> tuple[Any, Any]:
    class Simulator(ea.BaseSystemCollection, ea.Constraints, ea.Forcing):
        pass

    simulator = Simulator()
    modulus = rigidity / (np.pi * RADIUS**4 / 4)
    along, across = np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.0, 1.0])
    rod = ea.CosseratRod.straight_rod(
        ELEMENTS,
        np.zeros(3),
        along,
        across,
        LENGTH,
        RADIUS,
        linear_density / (np.pi * RADIUS**2),
        youngs_modulus=modulus,
        shear_modulus=modulus / 3,
    )
    simulator.append(rod)
    ends = {"constrained_position_idx": (0,), "constrained_director_idx": (0,)}
    simulator.constrain(rod).using(ea.OneEndFixedBC, **ends)
    simulator.add_forcing_to(rod).using(ea.GravityForces, acc_gravity=-9.81 * across)
    simulator.finalize()
    return simulator, rod
