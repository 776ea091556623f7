"""Robust fit of the map to the touched points."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from calibration.homography import Homography, Rejected, fit_homography
from calibration.lens import Lens
from calibration.touch_settings import TouchSettings
from drivers.errors import ConfigurationError
from drivers.types import Array


@dataclass(frozen=True, slots=True, eq=False)
class Touched:
    """One point: the pose's `number`, where the arm was, `place` (2,) x, z [m], and where the raw
    image showed it, `pixel` (2,). `again` for a second touch of the same pose.
    """

    number: int
    place: Array
    pixel: Array
    held_out: bool
    again: bool = False


@dataclass(frozen=True, slots=True)
class Solved:
    """The map from the points `used`, and its residuals at all points.

    `decide` are the held-out ones, `off` all outliers, `stubborn` those of them whose second touch
    is off by the same error, `wild` first touches that a second one replaced.
    """

    homography: Homography
    used: tuple[Touched, ...]
    decide: tuple[Touched, ...]
    off: tuple[Touched, ...]
    stubborn: tuple[Touched, ...]
    wild: tuple[Touched, ...]
    lens: Lens

    def error(self, touched: Touched) -> Array:
        """(2,) x, z [m]: where the map puts the point minus where the arm was."""
        seen = self.homography.to_plane(self.lens.undistort(touched.pixel))[0]
        return np.asarray(seen - touched.place)

    def named(self, touched: Touched) -> Rejected:
        """The point by its number, with its distance from the map in the image."""
        there = self.homography.to_image(touched.place)[0]
        off = float(np.hypot(*(there - self.lens.undistort(touched.pixel)[0])))
        return Rejected(touched.number, float(touched.place[0]), float(touched.place[1]), off)


def solve(touches: Sequence[Touched], lens: Lens, settings: TouchSettings) -> Solved:
    """Fit the newest touch of each fitted point robustly, then evaluate the map at all points.

    Independent of the order of `touches`. Raises ConfigurationError where they give no map.
    """
    newest = _newest(touches)
    fitted = [p for p in newest if not p.held_out]
    fit = fit_homography(
        lens.undistort(np.reshape([p.pixel for p in fitted], (-1, 2))),
        np.reshape([p.place for p in fitted], (-1, 2)),
    )
    used = tuple(p for p, inside in zip(fitted, fit.used, strict=True) if inside)
    whole = Solved(fit.homography, used, (), (), (), (), lens)
    outside = [p for p, inside in zip(fitted, fit.used, strict=True) if not inside]
    held = [p for p in newest if p.held_out]
    outside += [p for p in held if 1e3 * np.hypot(*whole.error(p)) > settings.worst_mm]
    firsts = {p.number: p for p in touches if not p.again}
    stubborn = tuple(p for p in outside if _repeats(p, firsts, whole, settings))
    scattered = tuple(p for p in outside if p.again and p not in stubborn)
    wild = tuple(
        firsts[p.number] for p in newest if p.again and p.number in firsts and p not in outside
    )
    decide = tuple(p for p in held if p not in scattered)
    return replace(whole, decide=decide, off=tuple(outside), stubborn=stubborn, wild=wild)


def _newest(touches: Sequence[Touched]) -> list[Touched]:
    """The second touch of a pose where there is one, ordered by place."""
    by_number = {p.number: p for p in sorted(touches, key=lambda p: (p.number, p.again))}
    return sorted(by_number.values(), key=lambda p: (p.place[0], p.place[1], p.number))


def _repeats(
    again: Touched, firsts: dict[int, Touched], solved: Solved, settings: TouchSettings
) -> bool:
    """Whether a second touch has the same error as the first: then the map is wrong there."""
    first = firsts.get(again.number)
    if first is None or not again.again:
        return False
    return 1e3 * float(np.hypot(*(solved.error(again) - solved.error(first)))) < settings.worst_mm


def suspects(touches: Sequence[Touched], lens: Lens, settings: TouchSettings) -> tuple[int, ...]:
    """Numbers of the points that disagree with the map of the rest and are touched again."""
    try:
        solved = solve(touches, lens, settings)
    except ConfigurationError:
        return ()
    return tuple(sorted(p.number for p in solved.off))
