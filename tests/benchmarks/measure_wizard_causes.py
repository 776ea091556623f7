"""What the calibration wizards say of clean sessions and of those in which one thing went wrong.

python -m tests.benchmarks.measure_wizard_causes [--clean N] [--each N]

Sessions of cameras drawn at random, as their optics project them: N clean ones of the board and N
of touches (a tenth of them loose), then boards bent by 0.7 to 3 mm, cameras turned by 0.3 to 2 mrad
among the touches, mirrored touches. Fails where a clean session is refused, or another one is not
refused for its own cause.
"""

import argparse
import sys
from collections.abc import Callable

import numpy as np

from calibration.board import BoardSettings
from calibration.wizard.lens_verdict import lens_verdict
from calibration.wizard.touch_verdict import touch_verdict
from tests.support.board_sessions import bent_session
from tests.support.touch_sessions import SETTINGS, Camera, touched

Reasons = tuple[str, ...]
BOARD, WILD = BoardSettings(), 0.1
BENT, TURNED = (0.0007, 0.001, 0.003), (0.3, 0.7, 2.0)  # m, mrad


def board(seed: int, height: float = 0.0) -> Reasons:
    """Reasons against a lens from a board bent by `height` [m] along its long side."""
    views = bent_session(BOARD, height, seed)
    return lens_verdict(views, (1280, 720), BOARD.width, BOARD).reasons


def touches(seed: int, mrad: float = 0.0, *, mirrored: bool = False) -> Reasons:
    """Reasons against the map of a camera that turns by `mrad` somewhere among the touches."""
    rng = np.random.default_rng(seed)
    camera, angle, after = Camera.drawn(rng), rng.uniform(0, 2 * np.pi), int(rng.integers(5, 20))
    nudge = 1e-3 * mrad * np.array([np.sin(angle), np.cos(angle), 0.0]) if mrad else None
    made = touched(camera, rng, nudge=nudge, after=after, mirrored=mirrored, wild=WILD)
    return touch_verdict(made, camera.lens, SETTINGS).reasons


def named(kind: str, count: int, cause: str, session: Callable[[int], Reasons]) -> bool:
    """Print and return whether all sessions were refused for `cause`; an empty one accepts."""
    found = [session(seed) for seed in range(count)]
    right = sum((len(r) == 0) if not cause else any(cause in each for each in r) for r in found)
    print(f"{kind:24s} {right:3d} of {count} {'accepted' if not cause else f'refused: {cause}'}")
    for reasons in found:
        if (cause and not any(cause in each for each in reasons)) or (not cause and reasons):
            print("    " + ("; ".join(reasons) or "accepted"))
    sys.stdout.flush()
    return right == count


def main() -> int:
    """Measure, print, and say whether all are what they are."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--clean", type=int, default=40)
    parser.add_argument("--each", type=int, default=12)
    given = parser.parse_args()
    fine = [named("flat board", given.clean, "", board)]
    for height in BENT:
        kind = f"board bent by {1e3 * height:.1f} mm"
        fine.append(named(kind, given.each, "is bent", lambda s, h=height: board(s, h)))
    fine.append(named("steady camera", given.clean, "", touches))
    for mrad in TURNED:
        kind = f"camera turned {mrad} mrad"
        fine.append(named(kind, given.each, "camera moved", lambda s, m=mrad: touches(s, m)))
    fine.append(named("mirrored", given.each, "mirrored", lambda s: touches(s, mirrored=True)))
    return 0 if all(fine) else 1


if __name__ == "__main__":
    sys.exit(main())
