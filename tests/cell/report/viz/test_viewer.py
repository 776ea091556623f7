"""What Rerun's own viewer shows of a fold, as a picture: nothing of it is blank."""

from pathlib import Path

import numpy as np
import pytest

from cell.interface.api import fold
from cell.record.run import read_run
from cell.report.viz.recording import viz_from_run
from drivers.base.types import Image
from tests.support.viewer import FOUND, cut, picture, recording_until

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(not FOUND, reason="no Xvfb with a Vulkan driver is here"),
]
LEAST = {"cell": 15.0, "film": 5.0, "verdict": 20.0, "states": 20.0, "curves": 8.0}
STRIP_EDGE = (255, 170, 50)  # RGB of the measured strip's edge
SHARES = {"begin": 0.0, "middle": 0.3, "end": 1.0}  # of the run's time


@pytest.fixture(scope="module", params=["twin", "fci"])
def shown(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory
) -> dict[str, Image]:
    """Pictures of a fold as its recording opens, and as it goes on."""
    place: Path = tmp_path_factory.mktemp(request.param)
    run = read_run(Path(fold("denim", arm=request.param, runs=place).run))
    recordings = {"begin": viz_from_run(run.folder)}
    for word in ("middle", "end"):
        end = SHARES[word] * float(run.ticks.t[-1])
        recordings[word] = recording_until(run.folder, end, place / f"{word}.rrd")
    return {
        word: picture(path, place / f"{word}.png") for word, path in recordings.items()
    }


@pytest.mark.parametrize("moment", SHARES)
@pytest.mark.parametrize("place", LEAST)
def test_no_part_of_the_view_is_blank(shown, moment, place) -> None:
    assert cut(shown[moment], place).mean(axis=2).std() > LEAST[place]


@pytest.mark.parametrize("moment", SHARES)
def test_hand_or_arm_stands_in_the_cell(shown, moment) -> None:
    part = cut(shown[moment], "cell").astype(int)
    is_white = (np.ptp(part, axis=2) < 12) & (part.mean(axis=2) > 140)
    assert is_white.mean() > 0.002


def test_measured_strip_is_drawn_while_it_is_folded_and_not_afterwards(shown) -> None:
    shares = {}
    for moment in SHARES:
        apart = np.abs(cut(shown[moment], "cell")[..., ::-1].astype(int) - STRIP_EDGE)
        shares[moment] = float((apart < 60).all(axis=2).mean())
    assert min(shares["begin"], shares["middle"]) > 2e-4
    assert shares["end"] < 1e-5
