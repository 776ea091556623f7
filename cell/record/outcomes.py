"""Valid names of a run's outcome, so that readers can refuse misspelt ones."""

GOALS = frozenset({"layer_touch", "path_done", "calibrated"})
NOT_FOLDED = frozenset({"edges_not_seen", "edges_apart", "unlike_model"})
"""The layers touched, which was measured, and yet nobody may call the strip folded."""
STOPS = frozenset({"interrupted", "preflight_refused", "error", "internal_error", "record", "exam"})
MONITORED = frozenset(
    {"overspeed", "tracking_error", "workspace", "force", "grip_lost", "overtime"}
)
MONITORED |= {"low_confidence", "state_overtime", "setpoint_expired", "calibration_overtime"}
MONITORED |= {"turn_overtime"}
REFUSED = frozenset({"command_refused", "motion_refused", "velocity_refused", "outside_workspace"})
CELL_OUTCOMES = frozenset(
    {"illegal_event", "no_perception", "process_died", "world_unknown", "unexpected"}
)
CELL_OUTCOMES |= {"no_aids", "no_latency"}
DEVICES = ("arm_", "hand_", "grasp_", "camera_", "image_", "simulation_", "strip_", "robot_")
"""Each device names its own faults after itself."""


def is_outcome(name: str) -> bool:
    """Whether `name` is a valid outcome, that of a run that ended well or the name of a fault."""
    known = GOALS | NOT_FOLDED | STOPS | MONITORED | REFUSED | CELL_OUTCOMES
    return name in known or name.startswith(DEVICES)
