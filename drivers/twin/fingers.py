"""Width between two fingers as a function of time."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Fingers:
    """A finger motion from `width` [m] at `start` [s] to `target` [m] at `speed` [m/s]."""

    width: float
    target: float
    start: float
    speed: float

    @property
    def end(self) -> float:
        """Time of arrival [s]."""
        return self.start + abs(self.target - self.width) / self.speed

    def at(self, time: float) -> float:
        """Width [m] between the fingers at `time` [s]."""
        travel = self.speed * max(time - self.start, 0.0)
        return float(min(max(self.target, self.width - travel), self.width + travel))
