"""Effects of drives and sensors: torques, commands and readings that are not as
stated.
"""

from collections.abc import Callable
from typing import Any

import numpy as np

from cell.gap.subject.mechanism.effect import (
    MechanismEffect,
    errors,
    per_joint,
    single_parameter,
)
from cell.gap.subject.mechanism.model import FORWARD, MODES, Mechanism, scale_gain
from drivers.base.types import Array
from drivers.strip.effects.effect import Parameter

ORDER = 6.0  # periods of a torque ripple in a turn, where nothing says otherwise


def _edit_constant(mechanism: Mechanism, values: Array, edited: Any) -> None:
    """Scale the gain and bias of each motor in the MuJoCo model `edited` by one plus
    its relative error in `values`.
    """
    for joint, error in zip(mechanism.driven.joints, values, strict=True):
        scale_gain(edited, joint.actuator, 1.0 + error)


def bias_law(q: Array, v: Array, load: Array, p: Array, at: int) -> Any:
    """Constant torque [N m] that equals the parameter `p[at]`, in an array of the same
    shape as the angles `q`, whatever the rates `v` and loads `load`.
    """
    return p[at] + 0.0 * q


def _ripple_shape(mechanism: Mechanism) -> tuple[Parameter, ...]:
    """Parameters that shape the cogging torque of each motor: its number of periods per
    turn, and its phase [rad].
    """
    driven = mechanism.driven
    orders = []
    for joint in driven.joints:
        quarter = np.clip(0.5 * np.pi / joint.travel, 0.5, 33.0)
        whole = 3.0 * quarter
        orders.append(
            Parameter(
                name=f"order_{joint.name}",
                unit="1",
                start=max(ORDER, whole),
                low=quarter,
                high=200.0,
                step=0.01,
                spread=ORDER,
                role="shape",
                own_from=whole,
            )
        )
    phases = per_joint(
        driven,
        "phase",
        "rad",
        np.full(len(orders), 0.04),
        signed=True,
        role="shape",
        high=100.0,
    )
    return (*orders, *phases)


def _ripple_law(q: Array, v: Array, load: Array, p: Array, at: int) -> Any:
    """Torque [N m] of a motor's cogging: the amplitude `p[at]` times the sine of `p[at
    + 1]` times the angle `q` [rad], shifted by the phase `p[at + 2]` [rad].

    Source: Holtz and Springob 1996, IEEE Trans. Ind. Electron. 43.
    """
    return p[at] * np.sin(p[at + 1] * q + p[at + 2])


def _saturation_parameters(mechanism: Mechanism) -> tuple[Parameter, ...]:
    """Parameters of the largest torque of each motor, each given as its reciprocal
    [1/(N m)], so that zero stands for no limit.
    """
    found = []
    for joint in mechanism.driven.joints:
        usual = 1.0 / joint.torque
        most = 20.0 * usual
        step = 1e-3 * usual
        name = f"torque_{joint.name}"
        found.append(
            Parameter(
                name=name,
                unit="N m",
                start=0.0,
                low=0.0,
                high=most,
                step=step,
                spread=usual,
                inverse=True,
            )
        )
    return tuple(found)


def _edit_saturation(mechanism: Mechanism, values: Array, edited: Any) -> None:
    """Narrow the force range of each motor in the MuJoCo model `edited` to its largest
    torque, whose reciprocal is in `values`.
    """
    for joint, inverse in zip(mechanism.driven.joints, values, strict=True):
        if inverse != 0.0:
            limits = edited.actuator_forcerange[joint.actuator]
            limits[:] = np.clip(limits, -1.0 / inverse, 1.0 / inverse)


TORQUE_CONSTANT = MechanismEffect(
    name="torque_constant",
    sentence="motors give another torque for their current than stated",
    of="rig",
    parameters=lambda m: errors(
        key="error",
        unit="1",
        names=[j.name for j in m.driven.joints],
        low=-0.9,
        high=3.0,
        spread=0.25,
    ),
    edit=_edit_constant,
    revealed_by="a known weight on the tip",
    error_of="gain",
)
TORQUE_BIAS = MechanismEffect(
    name="torque_bias",
    sentence="a drive adds a constant torque, or its sensor reads one",
    of="rig",
    parameters=lambda m: per_joint(
        m.driven, "torque", "N m", 0.01 * m.driven.torque, signed=True
    ),
    law=bias_law,
    of_drives=True,
    revealed_by="hold still in several poses",
)
TORQUE_RIPPLE = MechanismEffect(
    name="torque_ripple",
    sentence="a drive's torque ripples with its angle",
    parameters=lambda m: per_joint(
        m.driven, "amplitude", "N m", 0.01 * m.driven.torque, signed=True
    ),
    shape=_ripple_shape,
    keys=3,
    law=_ripple_law,
    of_drives=True,
    revealed_by="slow turns at a constant rate",
)
SATURATION = MechanismEffect(
    name="saturation",
    sentence="a drive gives no more than a largest torque",
    of="rig",
    parameters=_saturation_parameters,
    edit=_edit_saturation,
    revealed_by="fast starts and stops",
    modes=(FORWARD.name,),
    probes=(12.5, 25.0, 50.0),
)
CONTROL_DELAY = MechanismEffect(
    name="control_delay",
    sentence="commands take effect late",
    of="rig",
    parameters=lambda m: single_parameter("time", "s", 0.1 * m.file.step),
    possible=lambda m: bool(m.compared("tracking") or (m.mode.fields and m.model.nu)),
    read="command",
    revealed_by="fast starts and stops",
)
SENSOR_DELAY = MechanismEffect(
    name="sensor_delay",
    sentence="readings are stamped late (positions or, where negative, torques)",
    of="rig",
    # along a measured motion either clock may be the late one
    parameters=lambda m: single_parameter(
        "time", "s", 0.1 * m.file.step, signed=m.mode.loads
    ),
    read="delay",
    revealed_by="fast motion there and back",
)


def _encoder_errors(
    key: str, unit: str, largest: float, spread: float
) -> Callable[[Mechanism], tuple[Parameter, ...]]:
    """Function from a mechanism to an error, in `unit`, of each of its encoders: up to
    `largest` of either sign, with a prior of the standard deviation `spread`.
    """
    return lambda m: errors(
        key=key,
        unit=unit,
        names=m.mode.encoders(m),
        low=-largest,
        high=largest,
        spread=spread,
    )


ENCODER_BIAS = MechanismEffect(
    name="encoder_bias",
    sentence="encoders read a constant too much or too little",
    of="rig",
    parameters=_encoder_errors("bias", unit="rad", largest=0.2, spread=0.03),
    read="bias",
    modes=MODES,
    revealed_by="hold still in several poses",
)
ENCODER_SCALE = MechanismEffect(
    name="encoder_scale",
    sentence="encoders count too much or too little a turn",
    of="rig",
    # discs and gears count exactly, potentiometers and belts are within half a percent;
    # beyond 2 % lines or teeth would be miscounted, which any stop shows
    parameters=_encoder_errors("scale", unit="1", largest=0.02, spread=0.005),
    read="scale",
    revealed_by="large motion to both stops",
)
