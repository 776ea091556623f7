"""Rotor inertia: a drive adds the inertia of its rotor, geared up, to that of its joint."""

from cell.gap.subject.mechanism.effect import Effect, add_to, per_joint

EFFECT = Effect(
    name="armature",
    sentence="drives have rotor inertia that the model lacks",
    of="model",
    source="MJCF joint/armature: rotor inertia times the gear ratio squared",
    parameters=lambda m: per_joint(m, "inertia", "kg m^2", 0.01 * m.inertia, signed=False),
    edit=add_to("dof_armature"),
    revealed_by="fast starts and stops",
    error_of="armature",
)
