"""Valid names of outcomes, so that readers can refuse misspelt ones."""

GOALS = frozenset({"layer_touch", "path_done", "calibrated"})
STOPS = frozenset({"interrupted", "preflight_refused", "error", "internal_error", "record", "exam"})
MONITORED = frozenset(
    {"overspeed", "tracking_error", "workspace", "force", "grip_lost", "overtime"}
)
MONITORED |= {"low_confidence", "state_overtime", "setpoint_expired", "calibration_overtime"}
REFUSED = frozenset({"command_refused", "motion_refused", "velocity_refused", "outside_workspace"})
CELL = frozenset({"illegal_event", "no_perception", "process_died", "world_unknown", "unexpected"})
DEVICES = ("arm_", "hand_", "grasp_", "camera_", "image_", "simulation_", "strip_", "robot_")
"""Each device names its own faults after itself."""


def is_outcome(name: str) -> bool:
    """Whether `name` is `layer_touch`, `path_done` or the name of a fault."""
    known = GOALS | STOPS | MONITORED | REFUSED | CELL
    return name in known or name.startswith(DEVICES)
