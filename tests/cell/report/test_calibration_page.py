"""The page of a calibration: how good it is, and what speaks against it."""

import re
from dataclasses import replace

import pytest
from typer.testing import CliRunner

from calibration.calibration import save_calibration
from cell.cli.app import app
from cell.report.calibration_page import calibration_report
from drivers.errors import ConfigurationError
from tests.cell.report.test_report import outline, words
from tests.support.gap_strip_cases import STRIP


def test_page_shows_quality_scale_and_plane(calibration, tmp_path):
    path = tmp_path / "calibration.yaml"
    save_calibration(calibration, path)
    done = CliRunner().invoke(app, ["report", str(path)])
    assert done.exit_code == 0, done.output
    page = tmp_path / "calibration.html"
    assert done.stdout.strip() == str(page)
    text = page.read_text()
    assert outline(text).open == outline(text).crossed == []
    assert f"{calibration.residual_mm:.2f} mm" in words(text)
    near = calibration.to_image([[0.3, 0.1], [0.301, 0.1]])
    scale = 1.0 / (near[1, 0] - near[0, 0])
    shown = float(re.search(r"z 100 mm (\d\.\d) mm", words(text))[1])
    assert shown == pytest.approx(scale, abs=0.05)
    assert "verdict good" in text
    assert text.count("<svg") == 1


def test_refusals_of_the_wizard_are_shown(calibration):
    taken = replace(calibration, accepted_anyway=("two halves differ by 2.1 mm",))
    text = calibration_report(taken, "calibration.yaml")
    assert "verdict bad" in text
    assert "The wizard refused it: two halves differ by 2.1 mm" in words(text)


def test_a_file_of_another_kind_is_one_line(tmp_path):
    for text in (STRIP.read_text(), "a: 1\n"):
        (tmp_path / "other.yaml").write_text(text)
        done = CliRunner().invoke(app, ["report", str(tmp_path / "other.yaml")])
        assert isinstance(done.exception, ConfigurationError)
        said = str(done.exception)
        assert "other.yaml: is no calibration file: it holds none of id, camera" in said
        assert "\n" not in said
