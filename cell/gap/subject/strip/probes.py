"""How large an effect may be, before it is looked for: sizes to screen it at, and places."""

import numpy as np

from drivers.strip.effects.effect import Effect
from drivers.strip.file import StripFile

APART = 0.9  # bending lengths between the places at which an effect of one place is tried
BENT = 50.0  # 1/m, a sharp bend of a fold
UNKNOWN = (0.01, 0.1)  # of its range, for an effect that nothing is known of here


def sizes(effect: Effect, strip: StripFile) -> tuple[float, ...]:
    """Values of the effect's switch to screen at, small to large, as files state them.

    The smaller would just show in ten runs, the larger is as large as laboratories report it.
    """
    weight = strip.linear_density * 9.81 * strip.length
    mass = strip.linear_density * strip.length
    known = {
        "bending_hysteresis": (1.0, 5.0, 20.0),
        "nonlinear_bending": (-4e-6, 3e-5, 2e-4),
        "quadratic_damping": (1e-4, 1e-3),
        "relaxation": (0.03, 0.2),
        "stretch": (weight / 0.002, weight / 0.006, weight / 0.02),
        "air_drag": (0.3, 1.5),
        "pre_curl": (0.5, 5.0),
        "crease": (-0.3, 0.3),
        "stiffness_gradient": (0.2, 0.8),
        "seam": (1.8,),
        "hem_mass": (0.05 * mass,),
        "length_error": (0.0005, 0.003),
        "ageing": (0.003, 0.03),
        "end_slip": (10.0, 3.0, 1.5, 0.8),
        "grip_slip": tuple(weight * share for share in (4.0, 2.4, 1.6, 1.2, 1.0, 0.8)),
        "desk_tilt": (0.003, 0.02),
        "desk_height": (0.0005, 0.003),
        "tcp_offset": (0.0003, 0.003),
        "gripper_tilt": (0.01, 0.05),
        "gripper_compliance": (0.01 / (strip.rigidity * BENT), 0.1 / (strip.rigidity * BENT)),
        "control_delay": (0.003, 0.015),
        "camera_latency": (0.003, 0.015),
        "homography_scale": (0.0005, 0.005),
        "homography_shift": (0.0003, 0.003),
        "contact_bias": (0.001, 0.005),
    }
    switch = effect.parameters[0]
    span = UNKNOWN if switch.null is not None else UNKNOWN[::-1]
    found = known.get(effect.name) or tuple(share * switch.high for share in span)
    return tuple(float(np.clip(value, switch.low, switch.high)) for value in found)


def places(strip: StripFile, lifted: float) -> tuple[float, ...]:
    """Positions along the strip [m] to try, from where it leaves the desk, `lifted` [m], on.

    A bend shows an effect of one place while it passes, so that probes farther apart than about
    a bending length miss what lies between them.
    """
    begin = max(0.0, lifted - APART * strip.bending_length)
    count = max(2, round((strip.length - begin) / (APART * strip.bending_length)))
    return tuple(map(float, np.linspace(begin, strip.length, 2 * count + 1)[1::2]))
