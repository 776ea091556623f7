"""A rendered film of a phone becomes a run; what it does not show is named."""

from pathlib import Path

import pytest

from calibration.board import BoardSettings
from cell.base.config.places import find_configs
from cell.folding.filmed_board import calibrate_film
from cell.folding.observe import observe
from cell.record.film import Film
from drivers.base.errors import ConfigurationError
from tests.lab.benchmarks.measure_phone import LEAVING, STANDING, errors, render
from tests.support.commands import refused

CURVE, CONTACT = 2.0, 3.0  # mm rms


@pytest.mark.long
def test_a_film_of_a_phone_is_read_or_refused_by_name(tmp_path: Path) -> None:
    strip = find_configs(None).strip("denim")
    film = render(strip, {}, 3, 1, tmp_path, every=6)[0]
    frames = list(Film(film).frames())
    gone = [frame for frame in frames if frame.stamp > STANDING + LEAVING]
    fuchsia = strip.model_copy(update={"colour": (255, 0, 255)})
    short = strip.model_copy(update={"length": 0.97 * strip.length})
    refused = {
        "the printed board is not seen": (gone, strip),
        "the scene is never still": ([f for f in frames if f.stamp < STANDING], strip),
        "no strip of 600 mm": (frames, fuchsia),
        "mm long by the board": (frames, short),
    }
    for words, (shown, of) in refused.items():
        with pytest.raises(ConfigurationError, match=words):
            calibrate_film(film, iter(shown), BoardSettings(), of)
    found = observe(film, None, "denim", tmp_path / "run")
    off = errors(found, film)
    assert off["curve"] < CURVE
    assert off["contact"] < CONTACT
    assert found.read > 10


@pytest.mark.parametrize("given", [(), ("--board --calibration calibration.yaml",)])
def test_a_film_is_calibrated_by_a_board_or_by_a_file(
    given: tuple[str, ...],
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    text = refused(monkeypatch, capsys, "observe film.mp4 --strip denim", *given)
    assert "either --board or --calibration" in text
