"""Text of a verdict: one line a fact, its quality, and the next step."""

from collections.abc import Iterator
from dataclasses import dataclass
from enum import StrEnum

from calibration.wizard.check_verdict import CheckVerdict
from calibration.wizard.latency import LatencyVerdict
from calibration.wizard.lens_verdict import LensVerdict
from calibration.wizard.touch_verdict import Grade, TouchVerdict


class Level(StrEnum):
    """Quality of a fact."""

    GOOD = "good"
    FAIR = "fair"
    BAD = "bad"
    PLAIN = "plain"


@dataclass(frozen=True, slots=True)
class Line:
    """One line of a verdict."""

    level: Level
    text: str


def lens_lines(verdict: LensVerdict) -> tuple[Line, ...]:
    """Lines of the verdict on a session with the board."""
    lines = []
    if verdict.fit is not None:
        lens = verdict.fit.lens
        focal, centre = lens.matrix[0, 0], lens.matrix[:2, 2]
        lines = [
            Line(Level.PLAIN, f"{verdict.views} views, corners {verdict.fit.rms:.2f} px off (rms)"),
            Line(
                Level.PLAIN,
                f"focal length {focal:.0f} px, principal point {centre[0]:.0f}, {centre[1]:.0f} px",
            ),
            Line(
                _level(verdict.bend_mm, 0.3, 1.0),
                f"two halves of the views bend the image alike within {verdict.bend_mm:.2f} mm at "
                f"the board, and differ by {100 * verdict.split:.2f} % in focal length",
            ),
        ]
    lines += [Line(Level.BAD, reason) for reason in verdict.reasons]
    if verdict.passed:
        return (*lines, Line(Level.GOOD, "good: next, `cell calibrate homography`"))
    return (*lines, Line(Level.BAD, "refused: mend what is said above and go on"))


def touch_lines(
    touches: TouchVerdict | None, latency: LatencyVerdict | None, speed: float
) -> tuple[Line, ...]:
    """Lines of the verdict on touches and steps; `speed` [m/s] is that of a fold."""
    if touches is None:
        return (Line(Level.BAD, "refused: nothing was touched"),)
    lines = [*_map_lines(touches), *_latency_lines(latency, speed)]
    if touches.passed and latency is not None and latency.passed:
        level = Level.GOOD if touches.grade is Grade.GOOD else Level.FAIR
        return (*lines, Line(level, f"{touches.grade}: this calibration may be used"))
    return (*lines, Line(Level.BAD, "refused: mend what is said above and touch again"))


def check_lines(verdict: CheckVerdict) -> tuple[Line, ...]:
    """Lines of the verdict on an old calibration."""
    lines = [Line(Level.BAD, reason) for reason in verdict.reasons]
    if verdict.errors_mm:
        most = _level(verdict.worst_mm, 0.5, 1.0)
        words = f"half of {len(verdict.errors_mm)} touched points are under "
        words += f"{verdict.median_mm:.2f} mm off, the worst {verdict.worst_mm:.2f}"
        lines.insert(0, Line(most, words))
    if verdict.passed:
        return (*lines, Line(Level.GOOD, "good: this calibration still holds"))
    return (*lines, Line(Level.BAD, "refused: it no longer holds"))


def refusals(touches: TouchVerdict | None, latency: LatencyVerdict | None) -> tuple[str, ...]:
    """Every reason to refuse a calibration from these parts."""
    if touches is None:
        return ("nothing was touched",)
    late = ("the latency was not measured",) if latency is None else latency.reasons
    return (*touches.reasons, *late)


def _map_lines(touches: TouchVerdict) -> Iterator[Line]:
    if touches.homography is not None:
        yield Line(
            _level(touches.worst_mm, 0.5, 1.0),
            f"{touches.held_out} points that were not fitted are {touches.residual_mm:.2f} mm off "
            f"(rms), half of them under {touches.median_mm:.2f}, the worst {touches.worst_mm:.2f}",
        )
        yield Line(
            _level(touches.halves_mm, 0.5, 1.5),
            f"two maps from halves of the points agree within {touches.halves_mm:.2f} mm",
        )
        yield Line(
            _level(touches.displacement_mm, 1.0, 2.0),
            f"this moves the displacement by {touches.displacement_mm:.2f} mm (rms)",
        )
    for point in touches.wild:
        yield Line(Level.FAIR, f"{point}; touched again, where it agrees")
    for point in touches.rejected:
        yield Line(Level.FAIR, f"{point}; left out")
    for reason in touches.reasons:
        yield Line(Level.BAD, reason)


def _latency_lines(latency: LatencyVerdict | None, speed: float) -> Iterator[Line]:
    if latency is None:
        yield Line(Level.BAD, "the latency was not measured")
        return
    if not latency.reasons:
        behind = 1e3 * abs(latency.latency) * speed
        late = round(1e3 * latency.latency, 1) + 0.0  # never minus nothing
        yield Line(
            _level(1e3 * latency.apart, 2.0, 5.0),
            f"images show the world {late:+.1f} ms before their stamps, halves "
            f"agree within {1e3 * latency.apart:.1f} ms; taken back: at {speed:.2f} m/s this would "
            f"be {behind:.1f} mm",
        )
    for reason in latency.reasons:
        yield Line(Level.BAD, reason)


def _level(value: float, good: float, fair: float) -> Level:
    if value <= good:
        return Level.GOOD
    return Level.FAIR if value <= fair else Level.BAD
