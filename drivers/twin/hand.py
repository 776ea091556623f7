"""The twin's hand: two fingers that close on the strip's edge, or on nothing."""

from drivers.twin.clock import Event, Rank, TwinClock
from drivers.twin.settings import HandSettings
from drivers.twin.world import Fingers, World
from drivers.types import HandState

SOURCE = "twin hand"


class TwinHand:
    """Fingers that move in simulated time; a grasp holds if the edge lies between them."""

    def __init__(self, world: World, clock: TwinClock, settings: HandSettings) -> None:
        """An open hand over the strip of `world`."""
        self._world = world
        self._clock = clock
        self._settings = settings
        self._fingers = Fingers(
            settings.opening, settings.opening, start=clock.now(), speed=settings.speed
        )
        self._closing: Event | None = None
        world.move_fingers(self._fingers)

    def open(self) -> None:
        """Start to open the fingers; a held strip is released immediately."""
        self._world.detach()
        self._move(self._settings.opening)

    def grasp(self) -> None:
        """Start to close on the strip's edge; does nothing while it is held."""
        if self._world.holds_strip:
            return
        self._move(0.0)
        meeting = self._fingers.width - self._world.model.mechanics.thickness
        if meeting >= 0:
            at = self._fingers.start + meeting / self._settings.speed
            self._closing = self._clock.at(at, self._meet_strip, Rank.HAND)

    def state(self) -> HandState:
        """State of the fingers now: width, grasp and whether they move."""
        now = self._clock.now()
        return HandState(
            stamp=now,
            arrival=now,
            source=SOURCE,
            width=self._fingers.at(now),
            grasped=self._world.holds_strip,
            moving=now < self._fingers.end,
        )

    def stop(self) -> None:
        """Hold the fingers where they are."""
        self._move(self._fingers.at(self._clock.now()))

    def _move(self, target: float) -> None:
        if self._closing is not None:
            self._closing.cancel()
            self._closing = None
        now = self._clock.now()
        width = self._fingers.at(now)
        self._fingers = Fingers(width, target, start=now, speed=self._settings.speed)
        self._world.move_fingers(self._fingers)

    def _meet_strip(self, _: float) -> None:
        if self._world.edge_within(self._settings.reach, self._settings.lean):
            self._world.attach()
            self._move(self._world.model.mechanics.thickness)
