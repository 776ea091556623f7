"""`cell calibrate check`: a few points touched again tell whether a calibration still holds."""

from collections.abc import Callable

from calibration.calibration import Calibration
from calibration.wizard.check_verdict import CheckVerdict
from calibration.wizard.news import Watcher
from cell.config.cell import CellFile
from cell.devices.devices import Devices
from cell.operations.homography_wizard import touch
from cell.orchestrator.context import CalibrationContext
from cell.orchestrator.operator import Operator
from drivers.errors import ConfigurationError, Fault


def check_calibration(
    settings: CellFile,
    devices: Devices,
    calibration: Calibration,
    operator: Operator,
    watch: Watcher,
    interrupted: Callable[[], bool] = lambda: False,
) -> CheckVerdict:
    """The verdict on `calibration` after a touch of each pose of the check's plan.

    Raises ConfigurationError for one of another camera, Fault when a monitor stopped the arm, and
    Interrupted when the operator did.
    """
    if calibration.camera != devices.camera_identity:
        raise ConfigurationError(
            f"calibration: {calibration.id} belongs to camera {calibration.camera}, this one is "
            f"{devices.camera_identity}; name its own"
        )
    context = CalibrationContext(
        settings.controller, calibration.lens, operator=operator, watch=watch, old=calibration
    )
    touch(devices, context, interrupted)
    if context.check is None:
        raise Fault("illegal_event", "the check ended without a verdict")
    return context.check
