"""Offset of the hand from the strip's plane after lost commands, faded out smoothly."""

from drivers.motion import TICK

FADE_TICKS = 100  # ticks until the hand is back in the plane
NO_OFFSET = (0.0, 0.0, 0.0)

Numbers = list[float]


class FadingOffset:
    """Offset of the hand across the strip's plane [m] and two angles [rad], faded to zero.

    A robot that hears no command continues what it heard last, and with it the rounding of its
    state: it drifts out of the plane. From where it is found, with the velocity and acceleration
    that it has there, a polynomial of fifth degree takes each of the three to rest at zero.
    """

    def __init__(self) -> None:
        self._place: Numbers = list(NO_OFFSET)
        self._rate: Numbers = list(NO_OFFSET)
        self._change: Numbers = list(NO_OFFSET)
        self._age = FADE_TICKS

    def begin(self, place: Numbers, rate: Numbers, change: Numbers) -> None:
        """Fade from `place` (3,) [m, rad, rad] with its derivatives `rate` and `change` (3,)."""
        self._place, self._rate, self._change = place, rate, change
        self._age = 0

    def tick(self) -> tuple[float, float, float]:
        """Advance by one period; returns offset and angles (3,) [m, rad, rad] at its end."""
        if self._age >= FADE_TICKS:
            return NO_OFFSET
        self._age += 1
        share, duration = self._age / FADE_TICKS, FADE_TICKS * TICK
        left = (1.0 - share) ** 3
        weights = (
            left * (1.0 + 3.0 * share + 6.0 * share**2),
            left * share * (1.0 + 3.0 * share) * duration,
            left * share**2 * duration**2 / 2.0,
        )
        offset, about_x, about_z = (
            sum(w * part for w, part in zip(weights, parts, strict=True))
            for parts in zip(self._place, self._rate, self._change, strict=True)
        )
        return offset, about_x, about_z
