"""A film of a fold gives what the cell itself saw, without the arm, by another
encoder.
"""

from pathlib import Path

import numpy as np
import pytest

from cell.folding.observe import SIGMA_FLOORS, observe
from cell.record.files import CALIBRATION, OVERLAY
from cell.record.film import Film
from cell.record.run import Run, read_run
from drivers.base.errors import ConfigurationError
from tests.support.filmed_folds import encoded_again, filmed
from tests.support.seen_folds import distances

WITHIN = 0.0005  # m rms
FROM_GRIP = 0.01  # m about the held end, of which the fingers hide a part


def off(seen: Run, own: Run, begin: float) -> np.ndarray:
    """Distances [m] of all points seen in the film from the cell's own profiles."""
    stamps, lines = zip(*own.profile.curves(), strict=True)
    found = []
    for stamp, curve in seen.profile.curves():
        apart = np.abs(np.subtract(stamps, stamp + begin))
        at = int(apart.argmin())
        if apart[at] < 0.002:
            away = np.hypot(*(curve - curve[-1]).T) > FROM_GRIP
            found.append(distances(curve[away], lines[at]))
    return np.concatenate(found)


@pytest.mark.long
def test_a_film_by_another_encoder_gives_the_profiles_of_the_cell(
    tmp_path: Path,
) -> None:
    own, film, begin = filmed("denim", "triangular", tmp_path)
    again = encoded_again(film, "libx265")

    def interrupt(_time: float) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        observe(
            again, own.folder / CALIBRATION, "denim", tmp_path / "seen", None, interrupt
        )
    with pytest.raises(
        ConfigurationError, match=r"free edge is at x = .*, stated length 500 mm"
    ):
        observe(again, own.folder / CALIBRATION, "unknown:0.5", tmp_path / "seen")
    found = observe(again, own.folder / CALIBRATION, "denim", tmp_path / "seen")
    seen = read_run(found.folder)
    error = off(seen, own, begin)
    assert np.sqrt(np.mean(error**2)) < WITHIN
    assert len(seen.profile.curves()) > 0.9 * len(own.profile.curves())
    differs = seen.result.displacement - own.result.displacement
    assert abs(differs) < SIGMA_FLOORS["displacement"]
    assert sum(1 for _ in Film(found.folder / OVERLAY).frames()) > found.images
