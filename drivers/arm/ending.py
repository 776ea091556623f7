"""Handles termination signals in the process that moves the arm, so that it brakes first."""

import signal

from drivers.arm.failure import Cause, Failed, Failure

SIGNALS = (signal.SIGTERM, signal.SIGHUP)


class Ending:
    """Flag that SIGTERM or SIGHUP sets in this process; calling the object reads the flag.

    A closed terminal or a shutdown asks every process at once. One that died of it in a motion
    would leave it to the robot to notice that its commands stay away.
    """

    def __init__(self) -> None:
        self._heard = False
        for number in SIGNALS:
            signal.signal(number, self._note_signal)

    def __call__(self) -> bool:
        """Whether this process was asked to end."""
        return self._heard

    def check(self) -> None:
        """Raise Failed if this process was asked to end; to be called once the arm rests."""
        if self._heard:
            raise Failed(Failure(Cause.ENDED, "the process of the arm was asked to end"))

    def _note_signal(self, *_: object) -> None:
        self._heard = True
