"""Brings the arm to rest when nothing else may be relied on."""

from collections.abc import Callable

from cell.devices.devices import Devices
from drivers.types import ArmState, HandState


def suppressed(action: Callable[[], object]) -> bool:
    """Whether `action` went well; no error of it gets in the way of what must be done next."""
    try:
        action()
    except Exception:  # noqa: BLE001  an edge: whatever fails, the arm still has to stop
        return False
    return True


class SafeStop:
    """Asks the arm to stop, and again as long as it could not be told or does not answer.

    The camera is not looked at and nothing else is waited for: only the arm says when it rests.
    """

    def __init__(self, devices: Devices, turns: int) -> None:
        """For at most `turns` turns of the control loop."""
        self._devices = devices
        self._left = turns
        self._told = False

    def apply(self, hand: HandState | None) -> None:
        """Stop the arm, and fingers that were last seen moving."""
        self._told = suppressed(self._devices.arm.stop)
        if hand is None or hand.moving:
            suppressed(self._devices.hand.stop)

    def turn(self, due: float) -> ArmState | None:
        """One turn of braking, at `due` [s]: the arm's state, None where it does not answer."""
        self._left -= 1
        suppressed(lambda: self._devices.clock.wait_until(due))
        seen: list[ArmState] = []
        answered = suppressed(lambda: seen.append(self._devices.arm.state()))
        if not (answered and self._told):
            self._told = suppressed(self._devices.arm.stop)
        return seen[0] if seen else None

    def ended(self, arm: ArmState | None) -> bool:
        """Whether the arm rests, or has had its time."""
        return self._left <= 0 or (arm is not None and self._told and not arm.moving)
