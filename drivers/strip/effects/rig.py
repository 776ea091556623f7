"""Effects of the cell: desk, fixed edge, grip, the arm's poses, and errors of the
camera.
"""

import math
from collections.abc import Mapping
from functools import partial

from drivers.strip.effects.effect import Effect, Parameter, Stage, set_fields
from drivers.strip.model import StripModel, with_field

SHARP_CURVATURE = 50.0  # 1/m, a sharp bend of a fold
rig_effect = partial(Effect, of="cell", stage=Stage.BOUNDARY)
camera_effect = partial(Effect, of="cell", stage=Stage.OBSERVATION)

CONTROL_DELAY = rig_effect(
    name="control_delay",
    sentence="the arm reports its positions late",
    parameters=(Parameter.signed("time", "s", 0.2),),
    apply=set_fields(time="rig.delay"),
    typical=lambda _: (0.003, 0.015),
    looks_like=frozenset({"camera_latency"}),
    revealed_by="an empty-hand run under a second clock; a still image",
)

DESK_HEIGHT = rig_effect(
    name="desk_height",
    sentence="the desk is not at the height that the arm assumes",
    parameters=(Parameter.signed("height", "m", 0.02),),
    apply=set_fields(height="rig.desk_height"),
    typical=lambda _: (0.0005, -0.002, 0.003),
    revealed_by="the desk touched again with the gripper; folds of other heights",
)


def _tilt_desk(model: StripModel, values: Mapping[str, float]) -> StripModel:
    """Rotate gravity in the cell frame by the desk's slope `angle` [rad] along the
    strip.
    """
    weight = math.hypot(*model.boundary.gravity)
    pull = (weight * math.sin(values["angle"]), -weight * math.cos(values["angle"]))
    return with_field(model, "boundary.gravity", pull)


DESK_TILT = rig_effect(
    name="desk_tilt",
    sentence="the desk leans, so that weight pulls along the strip",
    parameters=(Parameter.signed("angle", "rad", 0.2),),
    apply=_tilt_desk,
    typical=lambda _: (0.003, -0.01, 0.02),
    revealed_by="a spirit level; the strip turned by 180 degrees",
)

END_SLIP = rig_effect(
    name="end_slip",
    sentence="the fixed edge slides on the desk",
    parameters=(Parameter.limit("friction", "1", low=0.05, high=10.0),),
    apply=set_fields(friction="boundary.edge_friction"),
    typical=lambda _: (10.0, 3.0, 1.5, 0.8),
    revealed_by="a taut lift, and a picture of the fixed edge before and after",
)

GRIP_SLIP = rig_effect(
    name="grip_slip",
    sentence="the strip slides in the grip",
    parameters=(Parameter.limit("force", "N", low=0.02, high=100.0),),
    apply=set_fields(force="boundary.grip_force"),
    typical=lambda strip: tuple(
        strip.weight * n for n in (4.0, 2.4, 1.6, 1.2, 1.0, 0.8, 0.5)
    ),
    revealed_by=(
        "a taut lift, there and back: afterwards the strip is longer than before"
    ),
)

GRIPPER_COMPLIANCE = rig_effect(
    name="gripper_compliance",
    sentence="the grip turns under the moment of the strip",
    parameters=(Parameter("compliance", "rad/(N m)", low=0.0, high=1e4),),
    apply=set_fields(compliance="boundary.grip_compliance"),
    typical=lambda strip: tuple(
        turn / (strip.rigidity * SHARP_CURVATURE) for turn in (0.01, 0.1)
    ),
    revealed_by="a stiff strip folded beside a soft one",
)

GRIPPER_TILT = rig_effect(
    name="gripper_tilt",
    sentence="the gripper is tilted against what the arm reports",
    parameters=(Parameter.signed("angle", "rad", 0.5),),
    apply=set_fields(angle="rig.grip_tilt"),
    typical=lambda _: (0.01, -0.03, 0.05),
    revealed_by="a picture of the gripper; folds with a short hanging part",
)

TCP_OFFSET = rig_effect(
    name="tcp_offset",
    sentence="the strip is held beside the point that the arm reports",
    parameters=(
        Parameter.signed("x", "m", 0.03),
        Parameter.signed("z", "m", 0.03),
    ),
    apply=set_fields(x="rig.grip_x", z="rig.grip_z"),
    typical=lambda _: (0.0003, -0.002, 0.003),  # taut on one side, slack on the other
    revealed_by="a picture of the grip; slow folds of other heights",
)

CAMERA_LATENCY = camera_effect(
    name="camera_latency",
    sentence="the camera shows the world later than its time stamps say",
    parameters=(Parameter.signed("time", "s", 0.2),),
    apply=set_fields(time="observation.camera_latency"),
    typical=lambda _: (0.003, 0.015),
    looks_like=frozenset({"control_delay"}),
    revealed_by="a fast fold against a slow one: the shift grows with speed",
)

CONTACT_BIAS = camera_effect(
    name="contact_bias",
    sentence=(
        "the camera sees the place where the strip leaves the desk too far out or in"
    ),
    parameters=(Parameter.signed("bias", "m", 0.05),),
    apply=set_fields(bias="observation.contact_bias"),
    typical=lambda _: (0.001, 0.005),
    looks_like=frozenset({"homography_shift"}),
    revealed_by="a strip lifted by hand to a known place",
)

HOMOGRAPHY_SCALE = camera_effect(
    name="homography_scale",
    sentence="the camera shows lengths too long or too short",
    parameters=(Parameter.signed("scale", "1", 0.1),),
    apply=set_fields(scale="observation.scale"),
    typical=lambda _: (0.0005, 0.005),
    revealed_by="the picture of a board or of two marks a known length apart",
)

HOMOGRAPHY_SHIFT = camera_effect(
    name="homography_shift",
    sentence="the camera shows every place off by the same shift",
    parameters=(
        Parameter.signed("x", "m", 0.05),
        Parameter.signed("z", "m", 0.05),
    ),
    apply=set_fields(x="observation.shift_x", z="observation.shift_z"),
    typical=lambda _: (0.0003, 0.003),
    looks_like=frozenset({"contact_bias"}),
    revealed_by="the picture of a mark at a known place, or of the gripper at rest",
)
