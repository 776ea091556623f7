"""Effects of measuring: systematic errors of the calibrated camera."""

from functools import partial

from drivers.strip.effects.effect import Effect, Parameter, Stage, sets

camera_effect = partial(Effect, of="cell", stage=Stage.OBSERVATION)

CAMERA_LATENCY = camera_effect(
    name="camera_latency",
    sentence="the camera shows the world later than its time stamps say",
    parameters=(Parameter("time", "s", low=-0.2, high=0.2),),
    apply=sets(time="observation.camera_latency"),
    typical=lambda _: (0.003, 0.015),
    looks_like=frozenset({"control_delay"}),
    revealed_by="a fast fold against a slow one: the shift grows with speed",
)

CONTACT_BIAS = camera_effect(
    name="contact_bias",
    sentence="the camera sees the place where the strip leaves the desk too far out or in",
    parameters=(Parameter("bias", "m", low=-0.05, high=0.05),),
    apply=sets(bias="observation.contact_bias"),
    typical=lambda _: (0.001, 0.005),
    looks_like=frozenset({"homography_shift"}),
    revealed_by="a strip lifted by hand to a known place",
)

HOMOGRAPHY_SCALE = camera_effect(
    name="homography_scale",
    sentence="the camera shows lengths too long or too short",
    parameters=(Parameter("scale", "1", low=-0.1, high=0.1),),
    apply=sets(scale="observation.scale"),
    typical=lambda _: (0.0005, 0.005),
    revealed_by="the picture of a board or of two marks a known length apart",
)

HOMOGRAPHY_SHIFT = camera_effect(
    name="homography_shift",
    sentence="the camera shows every place off by the same shift",
    parameters=(
        Parameter("x", "m", low=-0.05, high=0.05),
        Parameter("z", "m", low=-0.05, high=0.05),
    ),
    apply=sets(x="observation.shift_x", z="observation.shift_z"),
    typical=lambda _: (0.0003, 0.003),
    looks_like=frozenset({"contact_bias"}),
    revealed_by="the picture of a mark at a known place, or of the gripper at rest",
)
